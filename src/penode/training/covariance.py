"""Uncertainty under autocorrelated residuals: the HAC sandwich and the influence of each window."""

from dataclasses import dataclass
from functools import cached_property, partial

import jax
import numpy as np

from penode.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    JaxArray,
    float64,
    on_device,
    with_shared_length,
)
from penode.data.windows import Windows
from penode.models.base import Model
from penode.models.layout import Layout
from penode.training.gauss_newton_terms import (
    GaussNewtonTerms,
    flat_directions,
    marquardt_scale,
)
from penode.validation.autocovariance import bandwidth_of

#: Length of the recordings, in HAC bandwidths, below which no deviation is given, and up to which
#: the quantiles of a normal distribution leave out too much (N. M. Kiefer and T. J. Vogelsang,
#: Econom. Theory 21 (2005) 1130, doi:10.1017/S0266466605050565: 2.3 in place of 1.96 at 10).
LEAST_BANDWIDTHS, _MANY_BANDWIDTHS = 5, 10

#: Part of a quantity along flat directions up to which the data determine it.
_SEEN = 1e-3

#: A quantity hangs on single windows if of many no more than this number weigh in its variance.
_FEW_WINDOWS = 2.5
_MANY_WINDOWS = 20


def bartlett(series: FloatArray, bandwidth: int) -> FloatArray:
    """Return sum over lags |l| < bandwidth of (1 - |l| / bandwidth) sum_t s_t s_(t+l)'.

    The series is (parameter, time). Positive semidefinite (Newey and West 1987,
    doi:10.2307/1913610), computed as the sum of squared overlapping block sums.
    """
    blocks = _block_sums(series, bandwidth)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow is reported as unknown
        return np.asarray(blocks @ blocks.T / bandwidth)


def reported_covariance(series: FloatArray, bandwidth: int) -> FloatArray:
    """Return `bartlett` with the deviations by which 1.96 of them are an interval of 95 %.

    Of a series that is correlated over part of the bandwidth the kernel leaves out that part; a
    third of the bandwidth leaves out three times as much, which shows it (the over-lugsail window
    of Vats and Flegal 2022, doi:10.1093/biomet/asab049). Of few bandwidths the quantile is larger
    than a normal one (Kiefer and Vogelsang 2005, doi:10.1017/S0266466605050565): by 1.15 of ten.
    """
    whole = bartlett(series, bandwidth)
    third = bartlett_variance(series, max(bandwidth // 3, 1))
    variance = np.maximum(2 * np.diag(whole) - third, np.diag(whole))
    b = min(bandwidth / series.shape[1], 1.0)
    quantile = 1 + (2.9694 * b + 0.4160 * b**2 - 0.5324 * b**3) / 1.96
    return with_deviations(whole, quantile * np.sqrt(variance))


def bartlett_variance(series: FloatArray, bandwidth: int) -> FloatArray:
    """Return the diagonal of `bartlett`, shape (parameter,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.sum(_block_sums(series, bandwidth) ** 2, axis=1) / bandwidth)


def _block_sums(series: FloatArray, bandwidth: int) -> FloatArray:
    """Return sums over `bandwidth` columns, those that reach beyond the ends included."""
    padded = np.pad(np.cumsum(series, axis=1), ((0, 0), (bandwidth, bandwidth - 1)), mode="edge")
    padded[:, :bandwidth] = 0.0
    return np.asarray(padded[:, bandwidth:] - padded[:, :-bandwidth])


@dataclass(frozen=True, eq=False)
class ScoreSeries:
    """How the columns of scores or influences lie in time, and over what they are correlated."""

    # The sample that a column belongs to: the middle of its window, or itself.
    places: IntArray
    # Samples of all recordings, and of the HAC bandwidth.
    samples: int
    bandwidth: int

    @classmethod
    def of_windows(cls, windows: Windows) -> "ScoreSeries":
        """Return that of scores by window: samples^0.6, at least two horizons."""
        samples = len(windows.states)
        bandwidth = max(int(samples**0.6), 2 * windows.horizon)
        return cls(windows.starts + windows.steps // 2, samples, bandwidth)

    @classmethod
    def of_samples(cls, series: FloatArray) -> "ScoreSeries":
        """Return that of influences by sample, (quantity, sample).

        Measurement noise is white, and a wide bandwidth costs degrees of freedom; what a model
        leaves out is correlated for long. So the bandwidth is what the series themselves ask for.
        """
        samples = series.shape[1]
        return cls(np.arange(samples), samples, bandwidth_of(series))

    @property
    def long_enough(self) -> bool:
        """Whether recordings show how their residuals vary: five bandwidths at least."""
        return self.samples >= LEAST_BANDWIDTHS * self.bandwidth

    @property
    def ample(self) -> bool:
        """Whether their variance is so well known that estimates over it are normal."""
        return self.samples >= _MANY_BANDWIDTHS * self.bandwidth

    @property
    def lags(self) -> int:
        """The bandwidth counted in columns."""
        return max(round(self.bandwidth * len(self.places) / self.samples), 1)

    def binned(self, values: FloatArray, width: int) -> FloatArray:
        """Return sums of values (quantity, column) over bins of time, shape (quantity, bin)."""
        bins = -(-self.samples // width)
        sums = [np.bincount(self.places // width, row, minlength=bins) for row in values]
        return np.reshape(sums, (len(values), bins))


class Reported:
    """The quantities a fit reports: physical parameters and the learned map on visited states.

    Parameters
    ----------
    layout : Layout
        Of the model.
    points : ndarray, shape (point, state)
        States at which the learned map is watched, SI units.
    """

    def __init__(self, layout: Layout[Model], points: FloatArray):
        self.layout = layout
        self._points = np.asarray(points, dtype=np.float64)

    def of_layout(self, layout: Layout[Model]) -> "Reported":
        """Return the same quantities of a model with another layout."""
        return Reported(layout, self._points)

    def jacobian(self, raw: FloatArray) -> FloatArray:
        """Return d(reported)/d(raw), shape (reported, parameter); physical parameters first."""
        with float64():
            return self._joined(_slopes(self.layout, on_device(raw), self._padded))

    def values(self, raw: FloatArray) -> FloatArray:
        """Return the reported quantities, shape (reported,), SI units."""
        with float64():
            return self._joined(_reported(self.layout, on_device(raw), self._padded))

    @cached_property
    def _padded(self) -> JaxArray:
        return with_shared_length(self._points.T, shortest=1)

    def _joined(self, parts: tuple[JaxArray, JaxArray]) -> FloatArray:
        """Return physical parameters and, behind them, the map without the points that pad."""
        physical, learned = (np.asarray(part) for part in parts)
        used = learned[:, : len(self._points)]
        return np.concatenate([physical, used.reshape(-1, *used.shape[2:])])


@partial(jax.jit, static_argnums=0)
def _reported(layout: Layout[Model], raw: JaxArray, points: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Return the physical parameters and the learned map (output, point)."""
    values = layout.values(raw)
    learned = layout.model(values[:, None]).learned(points)
    return layout.physical_values(values), learned


_slopes = jax.jit(jax.jacfwd(_reported, argnums=1), static_argnums=0)


def dominated_by_few_windows(terms: GaussNewtonTerms, jacobian: FloatArray) -> BoolArray:
    """Return which reported quantities, shape (reported,), one or two windows of many decide.

    A rollout that comes near a singularity is so sensitive to the parameters that it outweighs all
    others, and makes what it decides look certain.
    """
    size = np.abs(influence(terms, jacobian))
    with np.errstate(invalid="ignore"):  # of a parameter that ran away no influence is known
        squares = (size / np.maximum(size.max(axis=1, keepdims=True), 1e-300)) ** 2
        effective = squares.sum(axis=1) ** 2 / np.maximum((squares**2).sum(axis=1), 1e-300)
    few = ~(effective >= _FEW_WINDOWS)
    return np.asarray(few & (terms.scores.shape[1] >= _MANY_WINDOWS))


def sandwich(terms: GaussNewtonTerms, series: ScoreSeries) -> FloatArray:
    """Return A^-1 B A^-1, shape (parameter, parameter), however short the recordings are.

    A is the sum of S'S at the minimum, B the HAC covariance of the scores plus the variance of
    Gaussian priors.
    """
    inverse = terms.inverse
    meat = bartlett(terms.scores, series.lags) + terms.prior
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(inverse @ meat @ inverse)


def sandwich_deviation(
    terms: GaussNewtonTerms, jacobian: FloatArray, series: ScoreSeries
) -> FloatArray:
    """Return the deviations of reported quantities from A^-1 B A^-1, shape (reported,), SI units.

    The Jacobian is (reported, parameter). A series that is not long enough cannot show how
    residuals vary; its deviations are good enough to stop an optimiser by, or to compare horizons.
    """
    along = jacobian @ terms.inverse
    variance = bartlett_variance(along @ terms.scores, series.lags)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(variance + _prior_variance(terms, along)))


def prior_covariance(terms: GaussNewtonTerms, jacobian: FloatArray) -> FloatArray:
    """Return what Gaussian priors add to the covariance, (reported, reported), SI units.

    No window shows it.
    """
    along = jacobian @ terms.inverse
    if not isinstance(terms.prior, np.ndarray):
        return np.zeros((len(along), len(along)))
    return np.asarray(along @ terms.prior @ along.T)


def with_deviations(covariance: FloatArray, deviation: FloatArray) -> FloatArray:
    """Return the covariance of these deviations, (quantity,), with the correlations of another.

    Where a deviation is infinite, what it shares with others is not known: NaN.
    """
    own = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    ratio = np.divide(deviation, own, out=np.zeros_like(own), where=own > 0)
    with np.errstate(invalid="ignore"):
        scaled = covariance * np.outer(ratio, ratio)
    unknown = ~np.isfinite(deviation)
    scaled[unknown | unknown[:, None]] = np.nan
    np.fill_diagonal(scaled, deviation**2)
    return np.asarray(scaled)


def _prior_variance(terms: GaussNewtonTerms, along: FloatArray) -> FloatArray:
    if not isinstance(terms.prior, np.ndarray):
        return np.zeros(len(along))
    return np.maximum(np.sum((along @ terms.prior) * along, axis=1), 0.0)


def undetermined(terms: GaussNewtonTerms, jacobian: FloatArray) -> BoolArray:
    """Return which parameters share with a quantity what no window sees, (reported, parameter).

    A direction in which the normal matrix is flat has no variance in a pseudo-inverse, but none
    that is known. A row without any is of a quantity that the data determine.
    """
    flat = flat_directions(terms.normal)
    largest = np.maximum(np.abs(jacobian).max(axis=1, keepdims=True), 1e-300)
    rows = (jacobian / largest) / marquardt_scale(terms.normal)
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    along = rows @ flat
    seen = np.linalg.norm(along, axis=1, keepdims=True) <= _SEEN * size
    parts = np.abs(along @ flat.T) > _SEEN * size
    return np.asarray(parts & ~seen)


def influence(terms: GaussNewtonTerms, jacobian: FloatArray) -> FloatArray:
    """Return what each window contributed to each reported quantity, shape (reported, window)."""
    return np.asarray(jacobian @ terms.inverse @ terms.scores)
