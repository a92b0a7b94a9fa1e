"""The main path: model + experiments + plan -> Fit, one line a stage."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from penode.data.experiment import Experiment
from penode.data.quality import check_excitation
from penode.errors import InputError
from penode.horizon.account import Account
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Ascent, Observer, fitting_plan, ladder_plan
from penode.horizon.selection import Plateau, Selector
from penode.models.base import Model
from penode.predictors.base import Predictor
from penode.training.covariance import Reported
from penode.training.fit import Fit
from penode.training.plan import Plan
from penode.training.residuals import Objective, residual_scale
from penode.validation.coverage import thin
from penode.validation.free_run import require_predictable, with_unmeasured


def nobody(event: Mapping[str, Any]) -> None:
    """Observe nothing."""


DEFAULT_SELECTOR = Plateau()


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
    """
    began = time.monotonic()
    if not experiments:
        raise InputError("no recording came; give at least one.")
    start = start if isinstance(start, Start) else Start(start)
    plan = plan or fitting_plan(ladder_plan(), experiments)
    ascent = _prepare(start.model, experiments, plan, observer)
    for unseen in validation:
        require_predictable(ascent.objective.predictor, start.model, unseen)
    rungs = ascent.climb(plan, ascent.objective.layout.raw(start.model))
    choice = selector.select(rungs)
    wall_time = time.monotonic() - began
    provenance = {
        "training_time_s": wall_time,
        "placement": str(plan.placement),
        "solver": str(plan.solver),
    }
    return Account(ascent, start, plan, rungs, choice).fit(validation, provenance)


def _prepare(
    model: Model, experiments: Sequence[Experiment], plan: Plan, observer: Observer
) -> Ascent:
    measured = tuple(name for name in model.states if name not in model.unmeasured)
    for experiment in experiments:
        if len(experiment) > 1:
            check_excitation(experiment, measured)
    visited = np.concatenate([with_unmeasured(e, model).stack(model.states) for e in experiments])
    predictor = Predictor(experiments[0].time_step, plan.solver, plan.hold)
    scale = residual_scale(model, visited, plan.loss)
    objective = Objective(predictor, model, scale, plan.loss, len(experiments))
    reported = Reported(objective.layout, thin(visited, most=100))
    return Ascent(objective, reported, model, experiments, observer)
