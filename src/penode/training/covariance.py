"""Uncertainty under autocorrelated residuals: the HAC sandwich and the influence of each window."""

from functools import cached_property, partial

import jax
import numpy as np

from penode.arrays import BoolArray, FloatArray, JaxArray, float64, on_device, with_shared_length
from penode.data.windows import Windows
from penode.models.base import Model
from penode.models.layout import Layout
from penode.training.gauss_newton_terms import GaussNewtonTerms

#: Length of the recordings, in HAC bandwidths, below which no deviation is given.
LEAST_BANDWIDTHS = 5

#: A quantity hangs on single windows if of many no more than this number weigh in its variance.
_FEW_WINDOWS = 2.5
_MANY_WINDOWS = 20


def bartlett(series: FloatArray, bandwidth: int) -> FloatArray:
    """Return sum over lags |l| < bandwidth of (1 - |l| / bandwidth) sum_t s_t s_(t+l)'.

    Parameters
    ----------
    series : ndarray, shape (parameter, time)
        Scores or influences, ordered in time.
    bandwidth : int
        Lags beyond it are taken as uncorrelated.

    Returns
    -------
    ndarray, shape (parameter, parameter)
        Positive semidefinite (Newey and West 1987, doi:10.2307/1913610), computed as the sum of
        squared overlapping block sums.
    """
    blocks = _block_sums(series, bandwidth)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow is reported as unknown
        return np.asarray(blocks @ blocks.T / bandwidth)


def bartlett_variance(series: FloatArray, bandwidth: int) -> FloatArray:
    """Return the diagonal of `bartlett`, shape (parameter,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.sum(_block_sums(series, bandwidth) ** 2, axis=1) / bandwidth)


def _block_sums(series: FloatArray, bandwidth: int) -> FloatArray:
    """Return sums over `bandwidth` columns, those that reach beyond the ends included."""
    padded = np.pad(np.cumsum(series, axis=1), ((0, 0), (bandwidth, bandwidth - 1)), mode="edge")
    padded[:, :bandwidth] = 0.0
    return np.asarray(padded[:, bandwidth:] - padded[:, :-bandwidth])


def correlation_length(windows: Windows) -> int:
    """Return the default HAC bandwidth in samples: samples^0.6, at least two horizons."""
    return max(int(len(windows.states) ** 0.6), 2 * windows.horizon)


def bandwidth_in_windows(windows: Windows) -> int:
    """Return the default HAC bandwidth counted in windows."""
    spacing = len(windows.states) / len(windows.starts)
    return max(round(correlation_length(windows) / spacing), 1)


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


def sandwich_deviation(
    terms: GaussNewtonTerms, jacobian: FloatArray, windows: Windows
) -> FloatArray:
    """Return the deviations of reported quantities from A^-1 B A^-1, shape (reported,), SI units.

    Parameters
    ----------
    terms : GaussNewtonTerms
        At the minimum; A is the sum of S'S, B the HAC covariance of the scores plus the
        variance of Gaussian priors.
    jacobian : ndarray, shape (reported, parameter)
        Derivative of the reported quantities.
    windows : Windows
        Those the terms were summed over. Recordings of fewer than five HAC bandwidths cannot show
        how their residuals vary; the deviations are then infinite.
    """
    if not long_enough(windows):
        return np.full(len(jacobian), np.inf)
    return working_deviation(terms, jacobian, windows)


def long_enough(windows: Windows) -> bool:
    """Whether recordings show how their residuals vary: five HAC bandwidths at least."""
    return len(windows.states) >= LEAST_BANDWIDTHS * correlation_length(windows)


def dominated_by_few_windows(terms: GaussNewtonTerms, jacobian: FloatArray) -> BoolArray:
    """Return which reported quantities, shape (reported,), one or two windows of many decide.

    A rollout that comes near a singularity is so sensitive to the parameters that it outweighs all
    others, and makes what it decides look certain.
    """
    return dominated(influence(terms, jacobian))


def dominated(influences: FloatArray) -> BoolArray:
    """Return `dominated_by_few_windows` of influences (reported, window)."""
    squares = influences**2
    effective = squares.sum(axis=1) ** 2 / np.maximum((squares**2).sum(axis=1), 1e-300)
    return np.asarray((effective < _FEW_WINDOWS) & (influences.shape[1] >= _MANY_WINDOWS))


def sandwich(terms: GaussNewtonTerms, windows: Windows) -> FloatArray:
    """Return A^-1 B A^-1, shape (parameter, parameter), however short the recordings are.

    Parameters
    ----------
    terms : GaussNewtonTerms
        At the minimum; A is the sum of S'S, B the HAC covariance of the scores plus the
        variance of Gaussian priors.
    windows : Windows
        Those the terms were summed over.
    """
    inverse = terms.inverse
    meat = bartlett(terms.scores, bandwidth_in_windows(windows)) + terms.prior
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(inverse @ meat @ inverse)


def working_deviation(
    terms: GaussNewtonTerms, jacobian: FloatArray, windows: Windows
) -> FloatArray:
    """Return the sandwich's deviations, shape (reported,), however short the recordings are.

    Good enough to stop an optimiser by, where `sandwich_deviation` declines to report.
    """
    along = jacobian @ terms.inverse
    variance = bartlett_variance(along @ terms.scores, bandwidth_in_windows(windows))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(variance + _prior_variance(terms, along)))


def prior_deviation(terms: GaussNewtonTerms, jacobian: FloatArray) -> FloatArray:
    """Return what Gaussian priors add to the deviations, shape (reported,); no window shows it.

    Parameters
    ----------
    terms : GaussNewtonTerms
        At the minimum.
    jacobian : ndarray, shape (reported, parameter)
        Derivative of the reported quantities.
    """
    return np.sqrt(_prior_variance(terms, jacobian @ terms.inverse))


def _prior_variance(terms: GaussNewtonTerms, along: FloatArray) -> FloatArray:
    if not isinstance(terms.prior, np.ndarray):
        return np.zeros(len(along))
    return np.maximum(np.sum((along @ terms.prior) * along, axis=1), 0.0)


def influence(terms: GaussNewtonTerms, jacobian: FloatArray) -> FloatArray:
    """Return what each window contributed to each reported quantity, shape (reported, window).

    Parameters
    ----------
    terms : GaussNewtonTerms
        At the minimum.
    jacobian : ndarray, shape (reported, parameter)
        Derivative of the reported quantities.
    """
    return np.asarray(jacobian @ terms.inverse @ terms.scores)
