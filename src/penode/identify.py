"""The main path: model + experiments + plan -> Fit, one line a stage."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.horizon.account import Account, stopped
from penode.horizon.cross_checks import beside_anchor, beside_direct
from penode.horizon.identifiability import Start
from penode.horizon.ladder import (
    Ascent,
    Observer,
    RungFit,
    StoppedClimb,
    fitting_plan,
    ladder_plan,
)
from penode.horizon.selection import Choice, Plateau, Selector
from penode.models.base import Model
from penode.training.fit import Fit
from penode.training.plan import Plan
from penode.validation.free_run import require_predictable


def nobody(event: Mapping[str, Any]) -> None:
    """Observe nothing."""


DEFAULT_SELECTOR = Plateau()


class Stopped(KeyboardInterrupt):
    """Ctrl-C during a training of which some horizons were finished, with the best so far.

    Parameters
    ----------
    fit : Fit
        Of the finished horizons; its verdict is ``"stopped"`` unless the data cannot answer.
    """

    def __init__(self, fit: Fit):
        super().__init__(fit.horizon.reason)
        self.fit = fit


def identify(
    start: Model | Start,
    experiments: Sequence[Experiment],
    *,
    plan: Plan | None = None,
    selector: Selector = DEFAULT_SELECTOR,
    validation: Sequence[Experiment] = (),
    observer: Observer = nobody,
) -> Fit:
    """Find physical parameters and learned maps, and the horizon that makes them right.

    Parameters
    ----------
    start : Model or Start
        Where training begins.
    experiments : sequence of Experiment
        Recordings to train on, of one time step.
    plan : Plan, optional
        Stages of training; by default Levenberg-Marquardt up a ladder of horizons to 200.
    selector : Selector
        Picks the horizon; Lepski's plateau by default.
    validation : sequence of Experiment
        Recordings that are predicted but not trained on.
    observer : callable
        Told of each evaluation and rung.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        If a channel is missing, a state never moves, the recordings differ in time step or are
        too short, or the predictions diverge at the first horizon.
    Stopped
        On Ctrl-C after the first horizon; a KeyboardInterrupt that carries the fit so far.
    """
    began = time.monotonic()
    if not experiments:
        raise InputError("no recording came; give at least one.")
    start = start if isinstance(start, Start) else Start(start)
    plan = plan or fitting_plan(ladder_plan(), experiments)
    ascent = Ascent.of(start.model, experiments, plan, observer)
    for unseen in validation:
        require_predictable(ascent.objective.predictor, start.model, unseen)

    first = ascent.objective.layout.raw(start.model)

    def account(rungs: Sequence[RungFit], choice: Choice, found: tuple[str, ...] = ()) -> Fit:
        provenance = {
            "training_time_s": time.monotonic() - began,
            "placement": str(plan.placement),
            "solver": str(plan.solver),
        }
        return Account(ascent, start, plan, rungs, choice, found).fit(validation, provenance)

    try:
        # Matrices are small, and threads that wait for each other cost more than they bring.
        with threadpool_limits(1, "blas"):
            rungs = ascent.climb(plan, first)
            choice = selector.select(rungs)
            chosen = rungs[choice.index]
            found = beside_anchor(chosen, ascent.objective.layout.physical, start.anchor)
            if choice.index:
                found += beside_direct(ascent, plan, chosen, first)
    except StoppedClimb as stop:
        best = account(stop.rungs, stopped(selector.select(stop.rungs), plan))
        raise Stopped(best) from stop
    return account(rungs, choice, found)
