"""A plan made from the problem: its horizons, how many windows, which starts are estimated."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.data.windows import Jittered
from penode.errors import InputError
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, ignore_events, ladder_plan
from penode.models.base import Model
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.holds import FirstOrderHold, Hold
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
#: Holds that constant inputs are compared with, the simplest first; by how much the logarithm of
#: the likelihood decides between two (odds of 20 to 1, twice); a loss that is rounding; and the
#: logarithm of one that diverged.
_HOLDS: tuple[Hold, ...] = (FirstOrderHold(), BandLimitedHold())
_EVIDENCE, _EXACT, _DIVERGED = 6.0, 1e-24, 1e3


def default_plan(model: Model, experiments: Sequence[Experiment], seed: int = 0) -> Plan:
    """Return a ladder for a model and its recordings.

    A window has to show more than its own start: with unmeasured states a short one is fitted
    exactly, whatever the parameters are. The ladder begins where each window has four measured
    values for each state that it estimates at its start, at 1 where all states are measured. It
    ends at most of a recording that is short, which is simulation-error training, and there the
    windows overlap. The start of a measured state is one more measured sample: it is estimated too.

    Parameters
    ----------
    model : Model
    experiments : sequence of Experiment
        Recordings of one time step.
    seed : int
        Of the windows' places.

    Returns
    -------
    Plan
        With constant inputs; `penode.identify` asks the recordings whether they are (`with_hold`).

    Raises
    ------
    InputError
        If no state of the model is measured.
    """
    horizons = default_horizons(model, experiments)
    starts = {name: None for name in model.states if name not in model.unmeasured}
    plan = ladder_plan(horizons, seed=seed)
    return replace(
        plan,
        placement=Jittered(seed, fewest=_WINDOWS),
        loss=Loss(free_starts=starts),
        solver=Substeps(DEFAULT_SOLVER, 1),
    )


def with_hold(plan: Plan, start: Start, experiments: Sequence[Experiment]) -> Plan:
    """Return a plan whose hold predicts the recordings best.

    An input that was computed stands still from one sample to the next; one that was sampled goes
    straight, or as a band-limited signal does. A first horizon may show it best, where longer ones
    show what else is wrong; or one in the middle, where noise hides it in the first. So that hold
    is taken whose loss exceeds the least of any by least, at the horizon that speaks most against
    it. Of holds that are as good, within chance, the simplest.

    Parameters
    ----------
    plan : Plan
        With constant inputs, which stay where no other hold is better, and its penalties.
    start : Start
        Where training begins.
    experiments : sequence of Experiment
        Recordings of one time step.
    """
    if not start.model.inputs:
        return plan
    plans = [plan, *(replace(plan, hold=hold) for hold in _HOLDS)]
    middle = len(plan.stages) // 2
    stages = tuple(plan.stages[k] for k in sorted({0, (middle + 1) // 2, middle}))
    losses = np.array([_log_losses(replace(p, stages=stages), start, experiments) for p in plans])
    excess = np.max(losses - losses.min(axis=0), axis=1)
    measured = len(start.model.states) - len(start.model.unmeasured)
    chance = _EVIDENCE / (measured * sum(map(len, experiments)))
    return plans[int(np.argmax(excess <= excess.min() + chance))]


def _log_losses(plan: Plan, start: Start, experiments: Sequence[Experiment]) -> list[float]:
    """Return the logarithm of the loss at each of a plan's horizons."""
    problem = LadderProblem.of(start.model, experiments, plan, ignore_events)
    try:
        fits = problem.climb(plan, problem.objective.layout.raw(start.model)).fits
    except InputError:
        fits = ()
    known = [math.log(rung.solution.terms.loss + _EXACT) for rung in fits]
    return known + [_DIVERGED] * (len(plan.stages) - len(known))


def default_horizons(model: Model, experiments: Sequence[Experiment]) -> tuple[int, ...]:
    """Return the horizons of `default_plan`, steps, ascending."""
    states = len(model.states)
    measured = states - len(model.unmeasured)
    if not measured:
        raise InputError(
            f"no state of {type(model).__name__} is measured; name those that no sensor measures, "
            "and no others, in `unmeasured`."
        )
    first = math.ceil(_OVERDETERMINED * states / measured) - 1 if model.unmeasured else 1
    # The longest stretch of the shortest recording.
    samples = min(max(map(len, stretches)) for stretches in by_recording(experiments))
    last = int(min(_SHARE * samples, max(_LONG, _PART * samples)))
    if last <= first:
        return (max(min(first, samples - 1), 1),)
    steps = max(round(math.log(last / first, _FACTOR)), 1)
    return tuple(sorted({round(first * (last / first) ** (k / steps)) for k in range(steps + 1)}))
