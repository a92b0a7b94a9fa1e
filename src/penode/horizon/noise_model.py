"""A noise model beside the physics: the physics alone first, then its gain, at long horizons.

A window's own start and a gain that is free fit a short window whatever the physics is, and a gain
by which predictions grow without bound costs nothing there. So the model without it is climbed
first, and from where its parameters lie the gain is freed in windows in which a start is forgotten.
"""

import math
from dataclasses import replace

import equinox as eqx

from penode.errors import InputError
from penode.horizon.default_plan import default_plan
from penode.horizon.learned_part import searched as searched_part
from penode.horizon.search import Found, Search
from penode.models.kalman import ExtendedKalman
from penode.training.plan import Plan, Stage


def searched(search: Search, plan: Plan) -> Found:
    """Return what recordings show of a start, with its learned part and its noise model if any."""
    whole = search.start.model
    if not isinstance(whole, ExtendedKalman):
        return searched_part(search, plan)
    start = replace(search.start, model=whole.model)
    alone = start.with_penalties(default_plan(whole.model, search.experiments))
    found = searched_part(replace(search, start=start), alone)
    if found.climbed.climb.interrupted or found.check.interrupted:
        return found
    physics = found.climbed.climb.fits[found.climbed.choice.index].model
    begin = replace(found.start, model=eqx.tree_at(lambda m: m.model, whole, physics))
    climbed = found.climbed.plan
    try:
        long = replace(climbed, stages=_long(climbed.stages), detour=None, discrepancy=False)
        return replace(search, start=begin).with_hold_of(long)
    except InputError:  # with the gain, predictions diverge
        sentence = "The noise model is left out: with it the predictions diverge."
        warned = replace(found.start, warnings=(*found.start.warnings, sentence))
        return replace(found, start=warned)


def _long(stages: tuple[Stage, ...]) -> tuple[Stage, ...]:
    """Return the longer stages, from the middle of a ladder on."""
    middle = math.sqrt(stages[0].horizon * stages[-1].horizon)
    return tuple(stage for stage in stages if stage.horizon >= middle)
