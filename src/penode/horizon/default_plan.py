"""A plan made from the problem: its horizons, how many windows, which starts are estimated."""

import math
from collections.abc import Sequence
from dataclasses import replace

from penode.data.experiment import Experiment
from penode.data.rates import lengths, time_steps
from penode.data.stretches import by_recording
from penode.data.windows import Jittered
from penode.errors import InputError
from penode.horizon.ladder import ladder_plan
from penode.models.base import Model
from penode.models.measured import (
    dynamic_states,
    free_states,
    hidden_states,
    measured_units,
    nothing_measured,
)
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.one_step import Substeps
from penode.training.loss import Loss
from penode.training.plan import Plan

#: Measured values in a window of the first horizon over the states that it estimates at its start.
_OVERDETERMINED = 4
#: Factor from a horizon to the next, and windows of a recording, which overlap where few fit.
_FACTOR, _WINDOWS = 2.0, 40
#: The longest horizon: so many samples, or a part of a recording where that is more, but no more
#: than this share of it.
_LONG, _PART, _SHARE = 1000, 1 / 40, 0.8


def default_plan(model: Model, experiments: Sequence[Experiment], seed: int = 0) -> Plan:
    """Return a ladder for a model and its recordings.

    A window has to show more than its own start: with hidden states a short one is fitted exactly,
    whatever the parameters are. The ladder begins where each window has four measured values for
    each state that it estimates at its start, at 1 where all states are measured. It
    ends at most of a recording that is short, which is simulation-error training, and there the
    windows overlap. The start of a measured state is one more measured sample: it is estimated too.

    Parameters
    ----------
    model : Model
    experiments : sequence of Experiment
        Recordings, of one time step or several.
    seed : int
        Of the windows' places.

    Returns
    -------
    Plan
        With constant inputs; `penode.identify` asks the recordings whether they are.

    Raises
    ------
    InputError
        If no state of the model is measured.
    """
    horizons = default_horizons(model, experiments)
    starts = {name: None for name in dynamic_states(model) if name not in free_states(model)}
    plan = ladder_plan(horizons, seed=seed)
    return replace(
        plan,
        placement=Jittered(seed, fewest=_WINDOWS),
        loss=Loss(free_starts=starts),
        solver=Substeps(DEFAULT_SOLVER, 1),
    )


def default_horizons(model: Model, experiments: Sequence[Experiment]) -> tuple[int, ...]:
    """Return the horizons of `default_plan`, steps of the shortest length, ascending."""
    states, measured = len(dynamic_states(model)), len(measured_units(model))
    if not measured:
        raise InputError(nothing_measured(model))
    needed = math.ceil(_OVERDETERMINED * max(states / measured, 1))
    first = needed - 1 if hidden_states(model) else 1
    if len(experiments) > 1 and first > 1:  # in the slowest recording too
        sampled = time_steps(experiments)
        first = math.ceil(first * sampled.max() / sampled.min())
    # The longest stretch of the shortest recording.
    own = dict(zip(map(id, experiments), lengths(experiments), strict=True))
    samples = min(max(own[id(e)] for e in stretches) for stretches in by_recording(experiments))
    last = int(min(_SHARE * samples, max(_LONG, _PART * samples)))
    if last <= first:
        return (max(min(first, samples - 1), 1),)
    steps = max(round(math.log(last / first, _FACTOR)), 1)
    return tuple(sorted({round(first * (last / first) ** (k / steps)) for k in range(steps + 1)}))
