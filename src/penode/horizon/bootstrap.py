"""Estimates from resampled recordings: how they spread without a formula for their deviations."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import FloatArray, IntArray, one_blas_thread
from penode.data.experiment import Experiment, require_recordings
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.profile import minimised, physical_of, problem_of
from penode.training.covariance import ScoreSeries
from penode.training.plan import Plan


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Physical parameters, estimated from as many resampled recordings.

    Attributes
    ----------
    parameters : tuple of str
    values : ndarray, shape (draw, parameter)
        In SI units; draws whose predictions diverged are left out.
    horizon : int
        At which they were estimated.
    """

    parameters: tuple[str, ...]
    values: FloatArray
    horizon: int

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter over the draws."""
        return dict(zip(self.parameters, self.values.std(axis=0, ddof=1).tolist(), strict=True))

    @property
    def interval_95(self) -> dict[str, tuple[float, float]]:
        """The 2.5 and 97.5 % quantiles of each parameter over the draws."""
        low, high = np.quantile(self.values, [0.025, 0.975], axis=0).tolist()
        return dict(zip(self.parameters, zip(low, high, strict=True), strict=True))


@one_blas_thread
def bootstrap(
    fit: Fit,
    experiments: Sequence[Experiment],
    *,
    draws: int = 200,
    seed: int = 0,
    plan: Plan | None = None,
    progress: Callable[[int], None] = lambda number: None,
) -> Bootstrap:
    """Estimate the parameters anew from recordings whose windows are drawn with replacement.

    Windows that follow each other are drawn together, in blocks as long as the bandwidth within
    which residuals may be correlated. Training goes on from the fit at the horizon that was chosen,
    or at the next shorter one whose blocks the recordings have five of.

    Parameters
    ----------
    fit : Fit
        Of a model of one's own.
    experiments : sequence of Experiment
        The recordings that it was trained on.
    draws : int
        At least 2; quantiles want some hundreds.
    seed : int
        Of the draws.
    plan : Plan, optional
        With which the fit was made; by default `penode.engine.default_plan`.
    progress : callable, optional
        Told the number of each finished draw, from 1.

    Returns
    -------
    Bootstrap
        Its spread is that of the residuals at that horizon alone: what differs between horizons,
        and the accuracy of sensors, is in ``fit.parameters`` and not here.

    Raises
    ------
    InputError
        If no horizon was chosen, there are fewer than 2 draws, or recordings have fewer than five
        blocks at every horizon.

    Notes
    -----
    Circular blocks: Politis and Romano, in Exploring the Limits of Bootstrap, Wiley 1992, p. 263.
    """
    require_recordings(experiments, ())
    if draws < 2 or fit.predictor is None or not fit.horizon.selected:
        what = f"draws must be >= 2, got {draws}" if draws < 2 else "the fit has no chosen horizon"
        raise InputError(f"{what}; give some hundreds, and a fit by penode.identify.")
    horizons = [r.horizon for r in fit.horizon.ladder if r.horizon <= fit.horizon.selected]
    for horizon in sorted(horizons, reverse=True):
        problem, raw = problem_of(fit, experiments, plan, horizon)
        series = ScoreSeries.of_windows(problem.windows)
        if series.long_enough:
            break
    else:
        raise InputError(
            f"recordings must have five blocks of {series.bandwidth} samples at horizon {horizon}, "
            f"got {series.samples} samples; record longer."
        )
    best = minimised(problem, raw)
    random, values = np.random.default_rng(seed), []
    for number in range(draws):
        drawn = resampled(len(problem.windows), series.lags, random)
        again = replace(problem, windows=problem.windows.among(drawn))
        found = minimised(again, raw if best is None else best[1])
        if found is not None:
            values.append(physical_of(problem, found[1]))
        progress(number + 1)
    names = problem.objective.layout.physical
    return Bootstrap(names, np.array(values).reshape(-1, len(names)), horizon)


def resampled(count: int, block: int, random: np.random.Generator) -> IntArray:
    """Return as many places of a series as it has, in blocks drawn with replacement, ascending."""
    begins = random.integers(count, size=-(-count // block))
    places = (begins[:, None] + np.arange(block)) % count
    return np.sort(places.ravel()[:count])
