"""Priors act where they are declared, as strong as the recordings' own residuals make them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from penode.data.experiment import Experiment
from penode.horizon.identifiability import Start
from penode.horizon.ladder import HorizonFit, LadderProblem, ignore_events
from penode.models.base import Model
from penode.models.layout import Layout
from penode.training.covariance import bandwidth_in_windows, bartlett
from penode.training.gauss_newton_terms import squared
from penode.training.penalties import GaussianPrior, Priors
from penode.training.plan import Plan


def with_declared_priors(plan: Plan, start: Start, experiments: Sequence[Experiment]) -> Plan:
    """Return a plan whose loss has the priors that the model's parameters were declared with.

    The data's loss is a mean of squares; a prior weighs against it as one more measurement does,
    by the variance of a residual over the number of independent ones. Both are taken together from
    the scores: where B is their long-run covariance and A the sum of squared sensitivities, the
    trace of B / A over that of A / A is the variance that an independent residual would have. The
    first horizon shows it, trained without priors.

    Parameters
    ----------
    plan : Plan
        One with `penode.engine.Priors` in its loss says by itself how strong they are, and stays.
    start : Start
        Where training begins.
    experiments : sequence of Experiment
        Recordings of one time step.

    Raises
    ------
    InputError
        If the predictions diverge at the first horizon.
    """
    layout, loss = Layout(start.model, len(experiments)), plan.loss
    declared = any(setting.prior for setting in layout.settings)
    if not declared or any(isinstance(penalty, Priors) for penalty in loss.penalties):
        return plan
    priors = declared_priors(layout, _variance(plan, start, experiments))
    return replace(plan, loss=replace(loss, penalties=(*loss.penalties, *priors)))


def declared_priors(layout: Layout[Model], variance: float) -> tuple[GaussianPrior, ...]:
    """Return the priors declared with a model's parameters, one for each group that has any.

    Parameters
    ----------
    layout : Layout
        Of the model.
    variance : float
        Of an independent residual over the number of all, in units of the loss.
    """
    mean, deviation = layout.priors
    groups = {setting.group: None for setting in layout.settings if setting.prior}
    priors = []
    for group in groups:
        members = layout.value_members((group,))
        rows = np.flatnonzero(np.isfinite(deviation[members]))
        factor = np.sqrt(variance) * np.diag(1 / deviation[members])[rows]
        believed = factor @ mean[members]
        priors.append(GaussianPrior(factor, np.full(len(rows), variance), believed, group))
    return tuple(priors)


def _variance(plan: Plan, start: Start, experiments: Sequence[Experiment]) -> float:
    """Return the variance of an independent residual over the number of all, as training shows."""
    problem = LadderProblem.of(start.model, experiments, plan, ignore_events)
    error = problem.objective.error
    spent = np.sum(error.stiffness == 0)  # at that horizon all goes into the windows' starts
    stages = [s for s in plan.stages if s.horizon * len(error.compared) > spent] or plan.stages
    first = replace(plan, stages=stages[:1])
    fit = problem.climb(first, problem.objective.layout.raw(start.model)).fits[0]
    slopes = problem.problem(first.stages[0], first).penalties(fit.solution.raw)[1]
    return _effective_variance(fit, slopes) / fit.solution.terms.count


def _effective_variance(fit: HorizonFit, slopes: np.ndarray) -> float:
    """Return tr(B / A) / tr(A / A), without what penalties of these slopes determine."""
    terms = fit.solution.terms
    scores = bartlett(terms.scores, bandwidth_in_windows(fit.windows))
    of_data = terms.normal - terms.count * squared(slopes)
    return float(np.sum(terms.inverse * scores) / np.sum(terms.inverse * of_data))
