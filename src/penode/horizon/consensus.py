"""Consensus: what the horizons of a plateau say together.

Windows of another horizon start elsewhere, and leave other errors behind. So the horizons of a
plateau err in part independently of each other, and their mean may be surer than any. Of an own
model the surest horizon's estimate is reported, less sure by what the others differ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from penode.arrays import FloatArray
from penode.fit.outcome import AGREED
from penode.horizon.ladder import HorizonFit
from penode.horizon.selection import Choice, weighted_covariance
from penode.training.covariance import (
    bartlett,
    bartlett_variance,
    reported_covariance,
    with_deviations,
)
from penode.training.gauss_newton_terms import FLAT, inverse_normal
from penode.training.plan import DIVERGED, Optimiser, Problem
from penode.training.second_order import LevenbergMarquardt

#: Weight of rungs that know their deviations from which on the mean's is given.
_MOST = 0.5

#: Fraction of the squared spread over a plateau that counts as bias of its mean. Of 32 drawn
#: recordings 88 % were covered with none of it, 94 % with a quarter, 97 % with half, all with all.
_BIAS = 0.5

#: Trains what is learned once more, with the physical parameters held.
_REFIT = LevenbergMarquardt(evaluations=15)

#: Probability of a mean outside the joint region of a rung by chance.
_BY_CHANCE = 1e-4

#: Probability of recordings that disagree by chance as much as they are said to agree.
_ALIKE = 0.05

#: Least deviation over the value: predictor and recording agree in nothing to more digits.
_FINEST = 1e-5

#: What a deviation comes from: rows of the uncertainty budget.
STATISTICS, HORIZON = "statistics of the residuals", "spread over the horizons"
PRIOR, NUMERICS = "prior of the learned map", "numerical agreement"
#: The row of the prior where priors of parameters are in it, and where points at rest are.
DECLARED, BESIDE = "declared priors", "priors and points at rest"
LEFT_OUT, BETWEEN = "what the model leaves out", "differences between the recordings"

#: Deviations are cut here, SI units, so that no weight is zero over zero.
_UNSURE = 1e100


@dataclass(frozen=True, eq=False)
class Consensus:
    """Physical parameters (SI) as rungs give them together, or as one gives them among them.

    `parts` are covariances (physical, physical) by what they come from; they add. Statistics have
    an infinite variance where most of the weight is on rungs that do not know their own deviation.
    """

    values: FloatArray
    parts: Mapping[str, FloatArray]
    # Whether they are the rungs' mean, not those of the chosen rung alone.
    mean: bool = True

    @property
    def deviation(self) -> FloatArray:
        """Deviations of the means, shape (physical,), SI units."""
        return np.sqrt(np.sum([np.diag(part) for part in self.parts.values()], axis=0))

    @classmethod
    def of(cls, rungs: Sequence[HorizonFit]) -> "Consensus":
        """Return what agreeing rungs say together.

        The variance is that of the weighted influences, in which what horizons share counts as
        shared, and half the square of the spread: influences do not show a bias, but part of the
        spread is the rungs' own chance, which is counted already. What priors add to the variances
        is one belief, shared by all.
        """
        values, weights = _weighed(rungs)
        middle, spread = _middle(values, weights)
        finite = np.isfinite([rung.deviation[: values.shape[1]] for rung in rungs])
        sure = np.sum(weights * finite, axis=0) >= _MOST
        statistics = weighted_covariance(rungs, weights)
        deviation = np.where(sure, np.sqrt(np.diag(statistics)), np.inf)
        parts = {
            STATISTICS: with_deviations(statistics, deviation),
            HORIZON: _BIAS * spread,
            PRIOR: _shared_prior(rungs, weights),
            **between_recordings(rungs, weights),
        }
        return cls(middle, {**parts, NUMERICS: _numerics(middle, parts)})

    def off_the_valley(self, chosen: HorizonFit) -> bool:
        """Return whether the means are outside the joint region of a rung they are means of.

        Estimates that lie along a bent valley of the loss agree one by one; their mean lies beside
        it.
        """
        gap = self.values - chosen.values[: len(self.values)]
        covariance = bartlett(chosen.influence, chosen.series.lags)
        priors = np.diag(np.broadcast_to(chosen.prior, covariance.shape))
        own = np.sqrt(np.diag(covariance) + priors)
        used = np.isfinite(own) & (own > 0)
        joint = covariance[np.ix_(used, used)] + np.diag(priors[used])
        scaled = joint / np.outer(own[used], own[used])
        distance = gap[used] / own[used]
        squared = distance @ np.linalg.pinv(scaled, rcond=FLAT, hermitian=True) @ distance
        return bool(squared > chdtri(max(int(used.sum()), 1), _BY_CHANCE))

    @classmethod
    def around(
        cls, chosen: HorizonFit, rungs: Sequence[HorizonFit], bias: float = 1.0
    ) -> "Consensus":
        """Return what one rung says, less sure by the spread of those it is chosen from.

        A fraction of the squared spread counts as bias: what is not chance that is counted already.
        """
        values, weights = _weighed(rungs)
        _, spread = _middle(values, weights)
        physical = values.shape[1]
        own = reported_covariance(chosen.influence, chosen.series.lags)
        known = np.isfinite(chosen.deviation[:physical])
        statistics = with_deviations(own, np.where(known, np.sqrt(np.diag(own)), np.inf))
        between = between_recordings([chosen], np.ones((1, physical)))
        parts = {STATISTICS: statistics, HORIZON: bias * spread, **between}
        if np.any(chosen.prior):
            parts[PRIOR] = np.broadcast_to(chosen.prior, statistics.shape)
        own_values = chosen.values[:physical]
        return cls(own_values, {**parts, NUMERICS: _numerics(own_values, parts)}, mean=False)

    @classmethod
    def reported(cls, choice: Choice, rungs: Sequence[HorizonFit]) -> "Consensus":
        """Return what is reported of a climbed ladder: one rung's estimate, or a plateau's mean.

        A mean beside a bent valley of the loss is not reported either.
        """
        chosen, agreeing = rungs[choice.index], [rungs[k] for k in choice.agreeing]
        if choice.verdict not in AGREED:
            return cls.around(chosen, agreeing)
        if not choice.averaged:
            return cls.around(chosen, agreeing, _BIAS)
        together = cls.of(agreeing)
        return cls.around(chosen, agreeing) if together.off_the_valley(chosen) else together


def _numerics(values: FloatArray, parts: Mapping[str, FloatArray]) -> FloatArray:
    """Return what is missing of a covariance's parts to the least deviation of values."""
    shown = np.sum([np.diag(part) for part in parts.values()], axis=0)
    return np.diag(np.maximum((_FINEST * values) ** 2 - shown, 0.0))


def between_recordings(rungs: Sequence[HorizonFit], weights: FloatArray) -> dict[str, FloatArray]:
    """Return what recordings that disagree add to the covariance of means; nothing of none.

    Each recording alone would move a mean by the sum of its influences; all together these sum to
    zero. Where they are larger than the residuals within recordings allow (Cochran's Q), each
    recording counts as one draw: the covariance clustered by recordings, less that of statistics
    (DerSimonian and Laird 1986, doi:10.1016/0197-2456(86)90046-2).
    """
    count = 1 + max(int(rung.windows.recording.max()) for rung in rungs)
    if count < 2:
        return {}
    moved, within = np.zeros((2, count, weights.shape[1]))
    for rung, weight in zip(rungs, weights, strict=True):
        own, deviation = _by_recording(rung, count)
        moved += np.where(weight > 0, weight * own, 0.0)
        within += np.where(weight > 0, weight * deviation, 0.0)
    disagreement = np.sum((moved / np.maximum(within, 1e-300)) ** 2, axis=0)
    clustered = count / (count - 1) * moved.T @ moved
    more = np.maximum(np.diag(clustered) - np.sum(within**2, axis=0), 0.0)
    more[~(disagreement > chdtri(count - 1, _ALIKE))] = 0.0
    return {BETWEEN: with_deviations(clustered, np.sqrt(more))} if more.any() else {}


def _by_recording(rung: HorizonFit, count: int) -> tuple[FloatArray, FloatArray]:
    """Return each recording's sum of influences and its deviation, (recording, physical)."""
    windows, lags = rung.windows, rung.series.lags
    known = np.unique(windows.recording)
    firsts = [windows.starts[windows.recording == k].min() for k in known]
    owner = known[np.maximum(np.searchsorted(firsts, rung.series.places, side="right") - 1, 0)]
    parts = [rung.influence[:, owner == k] for k in range(count)]
    sums = np.stack([part.sum(axis=1) for part in parts])
    variances = [bartlett_variance(part, lags) if part.size else sums[0] * 0 for part in parts]
    return sums, np.sqrt(np.stack(variances))


def _weighed(rungs: Sequence[HorizonFit]) -> tuple[FloatArray, FloatArray]:
    """Return the physical parameters of rungs and their precisions, both (rung, physical)."""
    physical = len(rungs[0].influence)
    values = np.stack([rung.values[:physical] for rung in rungs])
    precision = np.clip([rung.working[:physical] for rung in rungs], 1e-100, _UNSURE) ** -2.0
    return values, precision / precision.sum(axis=0)


def _middle(values: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weighted means (physical,) and covariance about them of values (rung, physical)."""
    middle = np.sum(weights * values, axis=0)
    apart = np.sqrt(weights) * (values - middle)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow is reported as unknown
        return middle, apart.T @ apart


def _shared_prior(rungs: Sequence[HorizonFit], weights: FloatArray) -> FloatArray:
    """Return what one belief adds to the covariance of weighted means: deviations add."""
    size = weights.shape[1], weights.shape[1]
    priors = np.stack([np.broadcast_to(rung.prior, size) for rung in rungs])
    own = np.sqrt(np.maximum(np.diagonal(priors, axis1=1, axis2=2), 0.0))
    root = np.sqrt(weights)
    together = np.sum(root[:, :, None] * priors * root[:, None, :], axis=0)
    return with_deviations(together, np.sum(weights * own, axis=0))


def map_weights(rungs: Sequence[HorizonFit]) -> FloatArray:
    """Return the precision of each rung's learned map, shape (rung,), summing to 1."""
    physical = len(rungs[0].influence)
    squares = np.array([np.sum(rung.working[physical:] ** 2) for rung in rungs])
    precision = 1 / np.clip(squares, 1e-300, _UNSURE)
    return np.asarray(precision / precision.sum())


def averaged(
    problem: Problem, rung: HorizonFit, rungs: Sequence[HorizonFit], values: FloatArray
) -> FloatArray:
    """Return raw parameters (parameter,): physical ones as given, maps as rungs give them together.

    The mean map is that of the mean physical parameters. To those given (SI units) it follows along
    the valley of a rung's loss, in which its coefficients c solve A_cc dc = -A_cp dp. All that
    moves and is not physical has to be a coefficient of a linear map.
    """
    layout, weights = problem.objective.layout, map_weights(rungs)
    middle = np.sum([w * one.solution.raw for w, one in zip(weights, rungs, strict=True)], axis=0)
    raw = layout.with_physical(middle, values)
    held = layout.physical_members[problem.moving]
    normal, step = rung.solution.terms.normal, (raw - middle)[problem.moving][held]
    follow = inverse_normal(normal[~held][:, ~held]) @ normal[~held][:, held] @ step
    raw[problem.moving & ~layout.physical_members] -= follow
    return raw


def retrained(
    problem: Problem, rung: HorizonFit, values: FloatArray, optimiser: Optimiser = _REFIT
) -> FloatArray:
    """Return raw parameters (parameter,): physical ones as given, the others where loss is least.

    The others follow from the rung's minimum, near which the given values (SI units) have to be.
    """
    layout = problem.objective.layout
    start = layout.with_physical(rung.solution.raw, values)
    others = problem.moving & ~layout.physical_members
    if np.array_equal(values, rung.values[: len(values)]) or not others.any():
        return start
    solution = optimiser.minimise(replace(problem, moving=others), start)
    return start if solution.outcome == DIVERGED else solution.raw
