"""Selection of the horizon: interchangeable small objects, each two-sided where it can be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Protocol

import numpy as np
from scipy.special import ndtri

from penode.arrays import BoolArray, FloatArray
from penode.horizon.ladder import Climb, HorizonFit
from penode.training.covariance import bartlett_variance, reported_covariance
from penode.training.plan import Plan

#: Runs whose least errors are within this factor are equally sure. Runs disagree, so that one of
#: them is wrong: less of a tie than between rungs that agree.
_AS_SURE = 1.05
#: A deviation over the median of those of all rungs below which it has collapsed.
_COLLAPSED = 1e-3
#: Error of a free run over the median of those of all rungs above which it is unstable.
_ASTRAY = 100.0


@dataclass(frozen=True)
class Choice:
    """A selector's answer.

    Attributes
    ----------
    index : int
        Selected rung.
    verdict, reason : str
        See `penode.fit.fit.HorizonChoice`.
    agreeing : tuple of int
        Indices of the rungs that agree with the selected one, itself included.
    averaged : bool
        Whether their mean is the answer, not the estimate of the selected one.
    """

    index: int
    verdict: str
    reason: str
    agreeing: tuple[int, ...]
    averaged: bool = False


def choose(selector: "Selector", climb: Climb, plan: Plan) -> Choice:
    """Return a selector's choice, marked as preliminary where the climb was interrupted."""
    choice = selector.select(climb.fits)
    if not climb.interrupted:
        return choice
    reason = f"The ladder was not climbed to its end. So far: {choice.reason}"
    if choice.verdict == "fixed":
        reason = f"The horizon asked for, {plan.stages[-1].horizon}, was not reached."
    return replace(choice, verdict="stopped", reason=reason)


def believable(climb: Climb) -> Climb:
    """Return a climb whose rungs do not know what one of them claims to know beyond belief.

    A deviation can collapse where a few windows cancel by chance, where training ended at the edge
    of numbers, or where predictions are unstable; the rung would outweigh all others.
    """
    physical = len(climb.fits[0].influence)
    working = np.stack([rung.working[:physical] for rung in climb.fits])
    finite = np.where(np.isfinite(working), working, np.nan)
    middle = [np.nanmedian(c) if np.isfinite(c).any() else 0.0 for c in finite.T]
    doubtful = (working < _COLLAPSED * np.asarray(middle)) | _unstable(climb)[:, None]
    if not doubtful.any():
        return climb
    fits = []
    for rung, few in zip(climb.fits, doubtful, strict=True):
        deviation, own = rung.deviation.copy(), rung.working.copy()
        deviation[:physical][few] = own[:physical][few] = np.inf
        fits.append(replace(rung, deviation=deviation, working=own))
    return replace(climb, fits=tuple(fits))


def _unstable(climb: Climb) -> BoolArray:
    """Return which rungs' free runs go astray where most rungs' do not, (rung,)."""
    known = [rung.free_run for rung in climb.fits if rung.free_run is not None]
    if len(known) < len(climb.fits):
        return np.zeros(len(climb.fits), bool)
    errors = np.stack(known)
    return np.any(errors > _ASTRAY * np.median(errors, axis=0), axis=1)


class Selector(Protocol):
    """Anything that picks a rung of a climbed ladder."""

    def select(self, rungs: Sequence[HorizonFit]) -> Choice:
        """Return the choice among rungs, shortest horizon first."""
        ...


@dataclass(frozen=True)
class Longest:
    """The longest horizon reached, for a user who named it."""

    def select(self, rungs: Sequence[HorizonFit]) -> Choice:
        """Return the last rung."""
        horizon = rungs[-1].horizon
        last = len(rungs) - 1
        return Choice(last, "fixed", f"The horizon was set to {horizon} by the user.", (last,))


@dataclass(frozen=True)
class Plateau:
    """The surest rung of the surest run of horizons whose estimates agree (after Lepski).

    Two rungs agree when their physical parameters differ by no more than the deviation of the
    difference allows; that deviation comes from the paired influences of their windows, so that
    what both horizons share cancels. They agree too when they differ by no more than the smaller of
    their own deviations: then it does not matter which is taken.

    Within a run each rung's mean squared error is estimated as its variance plus its squared
    distance from the run's precision-weighted mean, for physical parameters and for the learned
    map. Of several runs the one with the least such error is taken, or the longest of those that
    tie with it: an estimate may be right at short horizons as well as at long ones.

    The answer is the estimate of the rung whose deviations of the physical parameters have the
    least product, or the mean over the run, weighted by precision, as of machines and their maps.

    Attributes
    ----------
    level : float
        Probability of parting two equal rungs anywhere on the ladder (Bonferroni).
    rungs, factor : int, float
        A run with fewer rungs, or spanning a smaller factor in H, is no plateau.
    tie : float
        Where the mean is the answer, rungs within this factor of the smallest root mean squared
        error are as good; the shortest shows what needs one horizon, as residuals do.
    averaged : bool
        Whether the mean over the rungs is the answer.
    """

    level: float = 0.05
    rungs: int = 3
    factor: float = 4.0
    tie: float = 1.25
    averaged: bool = False

    def select(self, rungs: Sequence[HorizonFit]) -> Choice:
        """Return the choice among rungs, shortest horizon first."""
        run = self._run(rungs)
        index = run[self._best([rungs[k] for k in run])]
        physical = len(rungs[0].influence)
        known = [k for k in run if not physical or np.isfinite(rungs[k].working[:physical]).any()]
        known = known or list(run)
        low, high, chosen = rungs[run[0]].horizon, rungs[run[-1]].horizon, rungs[index].horizon
        if len(rungs) < self.rungs:
            reason = f"{len(rungs)} horizons cannot show a plateau; climb at least {self.rungs}."
            return Choice(index, "no plateau", reason, tuple(range(len(rungs))))
        if len(run) < self.rungs or high < self.factor * low:
            reason = (
                f"The estimates depend on the horizon: the longest agreement is H = {low} to "
                f"{high}. Record another regime; until then the range over the ladder is all that "
                "is known."
            )
            return Choice(index, "no plateau", reason, tuple(range(len(rungs))))
        others = [str(rung.horizon) for k, rung in enumerate(rungs) if k not in run]
        silent = [str(rungs[k].horizon) for k in run if k not in known]
        low, high = rungs[known[0]].horizon, rungs[known[-1]].horizon
        answer = "their weighted mean" if self.averaged else f"that of H = {chosen}, the surest,"
        shown = f" What needs one horizon, as residuals do, is shown at H = {chosen}."
        reason = (
            f"Estimates agree from H = {low} to {high}, and {answer} is the answer, "
            "also in what is exported"
            + f" (those at {', '.join(others)} differ by more than chance)" * bool(others)
            + f" (at H = {', '.join(silent)} it has no interval, and no weight)" * bool(silent)
            + f".{shown * self.averaged}"
        )
        verdict = "H = 1 suffices" if chosen == 1 else "plateau"
        return Choice(index, verdict, reason, tuple(known), self.averaged)

    def _best(self, rungs: Sequence[HorizonFit]) -> int:
        """Return which of agreeing rungs has the least deviation, or shows best what all say."""
        if not self.averaged:
            return _surest(rungs)
        error = _expected_errors(rungs)
        return int(np.argmax(error <= self.tie * error.min()))

    def _run(self, rungs: Sequence[HorizonFit]) -> tuple[int, ...]:
        """Return the run to choose in: a plateau if there is one, else the longest."""
        runs = _runs(_agreement(rungs, self.level), len(rungs))
        span = {run: rungs[run[-1]].horizon / rungs[run[0]].horizon for run in runs}
        wide = [run for run in runs if len(run) >= self.rungs and span[run] >= self.factor]
        if not wide:
            return max(runs, key=lambda run: (span[run], run[0]))
        least = {run: float(_expected_errors([rungs[k] for k in run]).min()) for run in wide}
        sure = [run for run in wide if least[run] <= _AS_SURE * min(least.values())]
        return max(sure, key=lambda run: (span[run], run[0]))


def _surest(rungs: Sequence[HorizonFit]) -> int:
    """Return the rung whose deviations of the physical parameters have the least product."""
    physical = len(rungs[0].influence) or None
    working = np.stack([rung.working[:physical] for rung in rungs])
    return int(np.argmin(np.log(np.clip(working, 1e-150, 1e150)).sum(axis=1)))


def _expected_errors(rungs: Sequence[HorizonFit]) -> FloatArray:
    """Return the expected root mean squared error of each rung, shape (rung,), up to a factor.

    Physical parameters and the learned map weigh the same: the geometric mean of both.
    """
    physical = len(rungs[0].influence)
    values = np.stack([rung.values for rung in rungs])
    variance = np.clip(np.stack([rung.working for rung in rungs]) ** 2, 1e-300, 1e300)
    weights = 1 / variance
    consensus = np.sum(values * weights, axis=0) / np.sum(weights, axis=0)
    apart = np.clip(values - consensus, -1e150, 1e150)  # a parameter may have run away
    squares = np.nan_to_num(variance + apart**2, nan=1e300, posinf=1e300)
    logs = [np.log(squares[:, :physical]).mean(axis=1)] if physical else []
    if squares.shape[1] > physical:
        logs.append(np.log(squares[:, physical:].mean(axis=1)))
    return np.asarray(np.exp(0.5 * np.mean(logs, axis=0))) if logs else np.ones(len(rungs))


def _agreement(rungs: Sequence[HorizonFit], level: float) -> set[tuple[int, int]]:
    pairs = list(combinations(range(len(rungs)), 2))
    physical = len(rungs[0].influence)
    limit = -ndtri(0.5 * level / max(len(pairs) * physical, 1))
    agreeing = set()
    for a, b in pairs:
        change = np.abs(rungs[b].values - rungs[a].values)[:physical]
        own = np.minimum(rungs[a].working, rungs[b].working)[:physical]
        if (change <= np.maximum(limit * paired_deviation(rungs[a], rungs[b]), own)).all():
            agreeing.add((a, b))
    return agreeing


def paired_deviation(a: HorizonFit, b: HorizonFit) -> FloatArray:
    """Return the deviation of the difference of two rungs' physical parameters, SI units."""
    return weighted_deviation([a, b], np.array([[1.0], [-1.0]]))


def weighted_deviation(rungs: Sequence[HorizonFit], weights: FloatArray) -> FloatArray:
    """Return the deviation of a weighted sum of rungs' physical parameters, (physical,), SI units.

    Weights are (rung, physical or 1).
    """
    return np.sqrt(bartlett_variance(*_weighted_influence(rungs, weights)))


def weighted_covariance(rungs: Sequence[HorizonFit], weights: FloatArray) -> FloatArray:
    """Return the covariance of the same sum as reported, (physical, physical), SI units."""
    return reported_covariance(*_weighted_influence(rungs, weights))


def _weighted_influence(rungs: Sequence[HorizonFit], weights: FloatArray) -> tuple[FloatArray, int]:
    """Return the weighted sum of rungs' influences, (physical, bin), and its bandwidth in bins.

    Influences are summed over bins of time by their place, and their weighted sum is one
    autocorrelated series: what the rungs share counts as shared.
    """
    width = max(rungs[0].series.samples // 1000, 16)
    longest = max(rung.series.bandwidth for rung in rungs)
    binned = np.stack([rung.series.binned(rung.influence, width) for rung in rungs])
    series = np.sum(weights[..., None] * binned, axis=0)
    return np.asarray(series), longest // width + 1


def _runs(agreeing: set[tuple[int, int]], count: int) -> list[tuple[int, ...]]:
    """Return the runs of rungs that agree pair by pair and cannot be made longer."""
    runs: list[tuple[int, ...]] = []
    for first in range(count):
        last = first
        while last + 1 < count and all((k, last + 1) in agreeing for k in range(first, last + 1)):
            last += 1
        if not runs or last > runs[-1][-1]:
            runs.append(tuple(range(first, last + 1)))
    return runs
