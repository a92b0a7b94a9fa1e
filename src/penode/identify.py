"""The main path: prepare, climb, select, cross-check, assemble."""

import time
from collections.abc import Sequence
from dataclasses import replace

from penode.arrays import one_blas_thread
from penode.data.experiment import Experiment, require_recordings
from penode.data.rates import nearest, time_steps
from penode.data.stretches import check_lengths
from penode.fit.fit import Fit
from penode.horizon.assemble import Assembly
from penode.horizon.declared_priors import with_declared_priors
from penode.horizon.default_plan import default_plan
from penode.horizon.held_out import require_single_steps, selector_for
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, Observer, ignore_events
from penode.horizon.learned_part import restored
from penode.horizon.noise_model import searched
from penode.horizon.objections import checks_of, guarded, objections, with_objections
from penode.horizon.search import Search
from penode.horizon.selection import Selector
from penode.horizon.steady import checks_of_points
from penode.horizon.wide_networks import with_held_layers
from penode.models.base import Model
from penode.models.checked import require_sound
from penode.training.plan import Plan
from penode.validation.free_run import require_predictable


class Stopped(KeyboardInterrupt):
    """Ctrl-C after some horizons were finished, or during the cross-check, with the best so far.

    Parameters
    ----------
    fit : Fit
        Of the finished horizons; its verdict is ``"stopped"`` unless the data cannot answer.
    """

    def __init__(self, fit: Fit):
        super().__init__(fit.horizon.reason)
        self.fit = fit


@one_blas_thread
def identify(
    start: Model | Start,
    experiments: Sequence[Experiment],
    *,
    plan: Plan | None = None,
    purpose: str | Selector = "parameters",
    validation: Sequence[Experiment] = (),
    observer: Observer = ignore_events,
) -> Fit:
    """Estimate physical parameters and learned maps, at the horizon that makes them right.

    Parameters
    ----------
    start : Model or Start
        Where training begins.
    experiments : sequence of Experiment
        Recordings to train on. Where they differ in their time step, a horizon is in steps of the
        shortest one, and predictions of all recordings are as long in time.
    plan : Plan, optional
        Stages of training; by default `penode.engine.default_plan`, made from model and recordings,
        with a zero-order, first-order or band-limited hold of the inputs, whichever predicts best,
        and as many sub-steps as leave the estimate where it is (16 at most).
    purpose : str or Selector
        What the horizon is chosen for: ``"parameters"`` (Lepski's plateau), ``"simulation"`` or
        ``"one_step"`` (the horizon that predicts best, `penode.engine.HeldOut`), or a
        rule of your own.
    validation : sequence of Experiment
        Recordings that are predicted but not trained on, of time steps that are trained on.
    observer : callable
        Receives an event for each evaluation and horizon.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        If a channel is missing, a state never moves, a recording is too short or one of the
        validation has a time step that none trained on has, the model has more than 5000
        parameters outside the hidden layers of networks, or the predictions diverge at the first
        horizon.
    Stopped
        On Ctrl-C after the first horizon; a KeyboardInterrupt that carries the fit so far.
    """
    began = time.monotonic()
    require_recordings(experiments, validation)
    start = start if isinstance(start, Start) else Start(start)
    selector = selector_for(purpose, validation or experiments)
    require_sound(start.model)
    if start.points is not None:
        start.points.require(start.model)
    require_single_steps(purpose, start.model, validation or experiments)
    given = plan
    plan = start.with_penalties(plan or default_plan(start.model, experiments))
    if given:
        plan = with_declared_priors(plan, start, experiments)
    problem = LadderProblem.of(start.model, experiments, plan, observer)
    check_lengths(experiments, max(s.horizon for s in plan.stages), problem.objective.error.past)
    for unseen in validation:
        near = nearest(time_steps(experiments), unseen)
        require_predictable(problem.objective.predictor.at(near), start.model, unseen)
    start = with_held_layers(start, problem, plan)

    search = Search(start, experiments, selector, observer)
    found = search.as_given(plan) if given else searched(search, plan)
    start, climbed, check = found.start, found.climbed, found.check
    problem, plan, climb, choice = climbed.problem, climbed.plan, climbed.climb, climbed.choice
    assembly = Assembly(problem, start, plan, climb.fits, choice, check)

    def examined() -> Fit:
        fit = restored(assembly.fit(validation, began))
        missed: list[str] = []
        checks = [
            guarded(one, missed)
            for one in (*start.checks, *checks_of_points(start), *checks_of(plan))
        ]
        raised = [*climbed.objections, *objections(fit, experiments, checks), *check.objections]
        return with_objections(replace(fit, warnings=(*missed, *fit.warnings)), raised)

    stopped = climb.interrupted or check.interrupted
    try:
        fit = examined()
    except KeyboardInterrupt:
        if stopped:
            raise
        # All horizons are done: what is left takes seconds, and makes a whole result of them.
        observer({"event": "stop", "horizon": climb.fits[-1].horizon})
        fit, stopped = examined(), True
    if stopped:
        raise Stopped(fit)
    return fit
