"""What is known beside recordings acts as strongly as their own residuals make it."""

from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np

from penode.arrays import FloatArray, float64, on_device
from penode.data.experiment import Experiment
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.models.base import Model
from penode.models.layout import Layout
from penode.training.covariance import bartlett
from penode.training.gauss_newton_terms import squared
from penode.training.penalties import GaussianPrior, Penalty, Priors
from penode.training.plan import Plan


def with_declared_priors(plan: Plan, start: Start, experiments: Sequence[Experiment]) -> Plan:
    """Return a plan whose loss has priors that were declared, and points at which the plant rests.

    The data's loss is a mean of squares. A prior weighs against it as one more measurement does if
    its squared standardised distance is multiplied by the variance of an independent residual over
    the number of all. That variance is the parameter's sandwich variance over its variance under
    white residuals of variance one: a prior as sure as the data then counts as much. The first
    horizon, trained without priors, shows it, and for points that of all parameters together.
    Priors of a plan with `penode.engine.Priors` stay as they are.
    """
    layout, loss, added = Layout(start.model, len(experiments)), plan.loss, list[Penalty]()
    declared = any(setting.prior for setting in layout.settings)
    declared &= not any(isinstance(penalty, Priors) for penalty in loss.penalties)
    if not declared and start.points is None:
        return plan
    rest = None if start.points is None else start.points.penalty(start.model)
    own, whole = _variances(plan, start, experiments)
    if declared:
        added += declared_priors(layout, own)
    if rest is not None:
        added.append(replace(rest, scale=whole))
    return replace(plan, loss=replace(loss, penalties=(*loss.penalties, *added)))


def declared_priors(layout: Layout[Model], variance: FloatArray) -> tuple[GaussianPrior, ...]:
    """Return the priors declared with a model's parameters, one for each group that has any.

    `variance` (value,) is of an independent residual over the number of all, in units of the loss.
    """
    mean, deviation = layout.priors
    priors = []
    for group in dict.fromkeys(s.group for s in layout.settings if s.prior):
        members = layout.value_members((group,))
        rows = np.flatnonzero(np.isfinite(deviation[members]))
        weight = np.sqrt(variance[members]) / deviation[members]
        believed = (weight * mean[members])[rows]
        priors.append(
            GaussianPrior(np.diag(weight)[rows], variance[members][rows], believed, group)
        )
    return tuple(priors)


def _variances(
    plan: Plan, start: Start, experiments: Sequence[Experiment]
) -> tuple[FloatArray, float]:
    """Return the variance of an independent residual over the number of all.

    For each value, and for all together.
    """
    ladder = LadderProblem.of(start.model, experiments, plan, ignore_events)
    error, layout = ladder.objective.error, ladder.objective.layout
    # At horizons as short all goes into the windows' starts.
    spent = error.spent
    stages = [s for s in plan.stages if s.horizon * len(error.compared) > spent] or plan.stages
    first = replace(plan, stages=tuple(stages[:1]))
    fit = ladder.climb(first, layout.raw(start.model)).fits[0]
    problem, terms = ladder.problem(first.stages[0], first), fit.solution.terms
    with float64():
        slopes = np.asarray(jax.jit(jax.jacfwd(layout.values))(on_device(fit.solution.raw)))
    along = slopes[:, problem.moving] @ terms.inverse
    scores = bartlett(terms.scores, fit.series.lags)
    of_data = terms.normal - terms.count * squared(problem.penalties(fit.solution.raw)[1])
    robust, white = (np.sum((along @ part) * along, axis=1) for part in (scores, of_data))
    whole = float(np.sum(terms.inverse * scores) / max(np.sum(terms.inverse * of_data), 1e-300))
    known = white > 0
    own = np.where(known, robust / np.where(known, white, 1.0), whole)
    return np.asarray(own / terms.count), whole / terms.count
