"""How large and how smooth a learned part is, by marginal likelihood.

Gauss and Newton give the likelihood of the learned parameters as a Gaussian, at the power at which
its residuals count as independent; a Gaussian process over what the map adds to the derivative is
the prior. Its amplitude and length maximise the evidence (D. J. C. MacKay, Neural Comput. 4 (1992)
415, doi:10.1162/neco.1992.4.3.415; G. Wahba, Ann. Stat. 13 (1985) 1378,
doi:10.1214/aos/1176349743), what is not learned integrated out as in restricted likelihood.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

from penode.arrays import BoolArray, FloatArray
from penode.training.covariance import ScoreSeries, bartlett
from penode.training.gauss_newton_terms import GaussNewtonTerms, inverse_normal

#: Directions of the data's information weaker than this do not show how their residuals vary.
_SHOWN = 1e-6
#: Keeps a matrix positive definite beyond rounding, over its diagonal.
_RIDGE = 1e-12
#: Length of what goes on over the whole region, in ranges; variance of what is at each point alone.
_WHOLE, _NUGGET = 1.0, 1e-6


@dataclass(frozen=True, eq=False)
class Information:
    """What data say of the learned parameters, a Gaussian about where training ended."""

    # Inverse covariance (learned, learned), everything else estimated too.
    matrix: FloatArray
    # Of the log likelihood, (learned,).
    slope: FloatArray
    # Of one independent residual: by it sums of squared residuals are divided.
    variance: float

    @classmethod
    def of(cls, terms: GaussNewtonTerms, learned: BoolArray, series: ScoreSeries) -> "Information":
        """Return the information of data without penalties.

        Residuals within a window, of windows that overlap, and of a model that misfits, are not
        independent. The likelihood is taken to the power at which its curvature agrees with the HAC
        covariance of the scores, on average over the learned directions (M. Ribatet, D. Cooley and
        A. C. Davison, Stat. Sinica 22 (2012) 813, doi:10.5705/ss.2009.248).
        """
        normal, scores = terms.normal, terms.scores
        others = ~learned
        follow = normal[learned][:, others] @ inverse_normal(normal[others][:, others])
        matrix = normal[learned][:, learned] - follow @ normal[others][:, learned]
        own = scores[learned] - follow @ scores[others]
        slope = own.sum(axis=1)
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300 + 1e-28 * np.diag(matrix).max()))
        eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(size, size))
        kept = eigenvalues > _SHOWN * eigenvalues[-1]
        centred = own - own.mean(axis=1, keepdims=True)
        along = (vectors[:, kept] / np.sqrt(eigenvalues[kept])).T @ (centred / size[:, None])
        ratios = np.diag(bartlett(along, series.lags))
        variance = float(np.mean(ratios))
        # Rounding may leave directions of which data know nothing below zero.
        known = np.sqrt(np.maximum(eigenvalues, 0.0)) * vectors * size[:, None]
        return cls(known @ known.T / variance, slope / variance, variance)


@dataclass(frozen=True, eq=False)
class Rows:
    """Linear combinations of the learned parameters believed to be of mean 0 and deviation 1.

    `slopes` is (row, learned), and `here` (row,) their values where training ended.
    """

    slopes: FloatArray
    here: FloatArray

    def with_rows(self, others: "Rows") -> "Rows":
        """Return these and others."""
        return Rows(
            np.concatenate([self.slopes, others.slopes]), np.concatenate([self.here, others.here])
        )

    def evidence(self, data: Information) -> float:
        """Return the log marginal likelihood up to a constant."""
        prior, pull = self.slopes.T @ self.slopes, self.slopes.T @ self.here
        left = data.slope - pull
        fit, joint = _solved(prior + data.matrix, left)
        alone, volume = _solved(prior, pull)
        return 0.5 * (fit - alone + volume - joint)


def beyond_rounding(matrix: FloatArray) -> FloatArray:
    """Return a positive semidefinite matrix, its diagonal larger by what makes it definite."""
    return matrix + np.diag(_RIDGE * np.diag(matrix))


def _solved(matrix: FloatArray, right: FloatArray) -> tuple[float, float]:
    """Return right' matrix^-1 right and the log determinant of a positive definite matrix."""
    size = np.sqrt(np.diag(matrix))
    factor = np.linalg.cholesky(beyond_rounding(matrix) / np.outer(size, size))
    half = solve_triangular(factor, right / size, lower=True)
    return float(half @ half), 2 * float(np.sum(np.log(np.diag(factor) * size)))


def process_rows(points: FloatArray, length: float, values: FloatArray) -> FloatArray:
    """Return values (output, point, ...) at points, whitened by a Gaussian process of deviation 1.

    Each output is a process of its own; points (point, channel) and the length are in ranges of the
    region. It is the sum of two of equal variance and of Matérn's covariance of order 3/2, of which
    cubic splines are the sample mean: one of the given length, and one as long as the region, so
    that what goes on over all of it, as physical terms can, is believed to be as large as the rest.
    """
    distance = np.sqrt(3.0) * cdist(points, points)
    both = [(1 + distance / one) * np.exp(-distance / one) for one in (length, _WHOLE)]
    factor = np.linalg.cholesky(np.mean(both, axis=0) + _NUGGET * np.eye(len(points)))
    flat = np.moveaxis(values, 0, 1).reshape(len(points), -1)
    white = solve_triangular(factor, flat, lower=True)
    return np.moveaxis(white.reshape(len(points), len(values), *values.shape[2:]), 1, 0)
