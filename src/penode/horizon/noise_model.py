"""A noise model beside the physics: the physics alone first, then the filter, at long horizons.

A window's own start and a filter that follows what is measured fit a short window whatever the
physics is. So the model without noise is climbed first, and from where its parameters lie the noise
is estimated in windows in which a start is forgotten.
"""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx

from penode.horizon.default_plan import default_plan
from penode.horizon.ladder import HorizonFit
from penode.horizon.learned_part import searched as searched_part
from penode.horizon.search import Found, Search
from penode.horizon.selection import Choice
from penode.models.kalman import ExtendedKalman
from penode.training.plan import Plan, Stage

#: Shortest horizon of the climb with noise, over the longest.
_PART = 0.12


def searched(search: Search, plan: Plan) -> Found:
    """Return what recordings show of a start, with its learned part and its noise model if any.

    No discrepancy is looked for beside a noise model: what is left over is noise to it.
    """
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
    stages = _long(found.climbed.plan.stages)
    long = replace(found.climbed.plan, stages=stages, detour=None, discrepancy=False)
    filtering = replace(search, start=begin).with_hold_of(long)
    choice = _of_longest(filtering.climbed.choice, filtering.climbed.climb.fits)
    return replace(filtering, climbed=replace(filtering.climbed, choice=choice))


def _of_longest(choice: Choice, rungs: Sequence[HorizonFit]) -> Choice:
    """Return the longest horizon of a plateau, whose noise is known best."""
    if choice.verdict != "plateau":
        return choice
    low, high = (rungs[k].horizon for k in (choice.agreeing[0], choice.agreeing[-1]))
    reason = f"Estimates agree from H = {low} to {high}, the longest, where noise is known best."
    return replace(choice, index=choice.agreeing[-1], reason=reason)


def _long(stages: tuple[Stage, ...]) -> tuple[Stage, ...]:
    """Return the longest stages: a sensor that is slowly forgotten counts in long windows alone."""
    return tuple(stage for stage in stages if stage.horizon >= _PART * stages[-1].horizon)
