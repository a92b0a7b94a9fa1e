"""How large and how smooth a learned part is, by marginal likelihood.

Gauss and Newton give the likelihood of the learned parameters as a Gaussian, at the power at which
its residuals count as independent; a Gaussian process over what the map adds to the derivative is
the prior. Its amplitude and length maximise the evidence (D. J. C. MacKay, Neural Comput. 4 (1992)
415, doi:10.1162/neco.1992.4.3.415; G. Wahba, Ann. Stat. 13 (1985) 1378,
doi:10.1214/aos/1176349743), what is not learned integrated out as in restricted likelihood.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.spatial.distance import cdist

from penode.arrays import FloatArray
from penode.data.windows import Windows
from penode.training.covariance import bandwidth_in_windows, bartlett
from penode.training.gauss_newton_terms import GaussNewtonTerms, inverse_normal

#: Directions of the data's information weaker than this do not show how their residuals vary.
_SHOWN = 1e-6


@dataclass(frozen=True, eq=False)
class Information:
    """What data say of the learned parameters, a Gaussian about where training ended.

    Attributes
    ----------
    matrix : ndarray, shape (learned, learned)
        Inverse covariance, everything else estimated too.
    slope : ndarray, shape (learned,)
        Of the log likelihood.
    variance : float
        Of one independent residual: by it sums of squared residuals are divided.
    """

    matrix: FloatArray
    slope: FloatArray
    variance: float

    @classmethod
    def of(cls, terms: GaussNewtonTerms, learned: FloatArray, windows: Windows) -> "Information":
        """Return the information of data without penalties.

        Residuals within a window, of windows that overlap, and of a model that misfits, are not
        independent. The likelihood is taken to the power at which its curvature agrees with the
        HAC covariance of the scores, on average over the learned directions (M. Ribatet, D. Cooley
        and A. C. Davison, Stat. Sinica 22 (2012) 813, doi:10.5705/ss.2009.248).

        Parameters
        ----------
        terms : GaussNewtonTerms
            Of the data alone.
        learned : ndarray of bool, shape (moving,)
        windows : Windows
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
        ratios = np.diag(bartlett(along, bandwidth_in_windows(windows)))
        variance = float(np.mean(ratios))
        return cls(matrix / variance, slope / variance, variance)


@dataclass(frozen=True, eq=False)
class Rows:
    """Linear combinations of the learned parameters believed to be of mean 0 and deviation 1.

    Attributes
    ----------
    slopes : ndarray, shape (row, learned)
    here : ndarray, shape (row,)
        Their values where training ended.
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
        joint = cho_factor(prior + data.matrix, lower=True)
        alone = cho_factor(prior, lower=True)
        left = data.slope - pull
        fit = left @ cho_solve(joint, left) - pull @ cho_solve(alone, pull)
        return float(0.5 * fit + _half_log_volume(alone) - _half_log_volume(joint))


def _half_log_volume(factor: tuple[FloatArray, bool]) -> float:
    return float(np.sum(np.log(np.diag(factor[0]))))


def process_rows(points: FloatArray, length: float, values: FloatArray) -> FloatArray:
    """Return values at points, whitened by a Gaussian process of deviation 1.

    Its covariance is Matérn's of order 3/2: cubic splines are as smooth as its sample mean.

    Parameters
    ----------
    points : ndarray, shape (point, channel)
    length : float
        In their unit.
    values : ndarray, shape (output, point, ...)
        Each output is a process of its own.
    """
    distance = np.sqrt(3.0) * cdist(points, points) / length
    covariance = (1 + distance) * np.exp(-distance) + 1e-6 * np.eye(len(points))
    factor = np.linalg.cholesky(covariance)
    flat = np.moveaxis(values, 0, -1).reshape(len(points), -1)
    white = solve_triangular(factor, flat, lower=True)
    return np.moveaxis(white.reshape(*np.moveaxis(values, 0, -1).shape), -1, 0)
