"""Weak form: parameters of a linear-in-parameters balance without differentiating data.

For a balance d/dt s = r with s = s_0 + sum_j c_j s_j and r = r_0 + sum_j c_j r_j, and a smooth test
function w that vanishes at the ends of a window, integration by parts gives one equation a window
and state,

    sum_j c_j (int w r_j + int w' s_j) = -(int w r_0 + int w' s_0),

linear in c. A Hann window over whole periods of a disturbance also nulls its harmonics from the
second on, so they cannot bias the coefficients.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.training.covariance import bartlett_variance

#: Singular values below this fraction of the largest are noise of the arithmetic.
_RANK_TOLERANCE = 1e-10
#: Windows overlap by three quarters: so many equations are worth one.
OVERLAP = 4
#: Equations that share samples with one, of two states.
_OVERLAPPING = 4 * OVERLAP


@dataclass(frozen=True, eq=False)
class WeakRegression:
    """Equations of the weak form.

    Attributes
    ----------
    matrix : ndarray, shape (equation, coefficient)
    target : ndarray, shape (equation,)
    """

    matrix: FloatArray
    target: FloatArray

    def solve(self) -> FloatArray:
        """Return the least-squares coefficients, shape (coefficient,)."""
        size = np.linalg.norm(self.matrix, axis=0)
        size = np.where(size > 0, size, 1.0)
        solution = np.linalg.lstsq(self.matrix / size, self.target, rcond=_RANK_TOLERANCE)[0]
        return np.asarray(solution / size)

    def deviation(self, column: int) -> float:
        """Return the HAC standard deviation of a least-squares coefficient.

        Parameters
        ----------
        column : int
            Index of the coefficient.

        Returns
        -------
        float
            From what the equations leave over, in their order (overlapping windows, recording by
            recording), correlated over rows^0.6 of them (Newey and West 1987,
            doi:10.2307/1913610).
        """
        influence = self.gain(column) * (self.target - self.matrix @ self.solve())
        lags = max(2 * int((len(influence) / 2) ** 0.6), _OVERLAPPING)
        return float(np.sqrt(bartlett_variance(influence[None], lags)[0]))

    def gain(self, column: int) -> FloatArray:
        """Return what each equation's target adds to a least-squares coefficient, (equation,).

        Parameters
        ----------
        column : int
            Index of the coefficient.
        """
        size = np.linalg.norm(self.matrix, axis=0)
        size = np.where(size > 0, size, 1.0)
        inverse = np.linalg.pinv(self.matrix / size, rcond=_RANK_TOLERANCE)
        return np.asarray(inverse[column] / size[column])

    def independence(self, column: int) -> float:
        """Return the fraction of a column's energy that no other column explains.

        Parameters
        ----------
        column : int
            Index of the coefficient.

        Returns
        -------
        float
            rho = 1 - R^2 of the column on all others: 1 independent, 0 indistinguishable (or a
            column of zeros, which nothing determines).
        """
        own = self.matrix[:, column]
        if not own.any():
            return 0.0
        others = np.delete(self.matrix, column, axis=1)
        size = np.linalg.norm(others, axis=0)
        others = others / np.where(size > 0, size, 1.0)
        explained = others @ np.linalg.lstsq(others, own, rcond=_RANK_TOLERANCE)[0]
        return float(np.sum((own - explained) ** 2) / np.sum(own**2))

    def steepness(self, column: int) -> float:
        """Return how fast the profile of a coefficient rises, in one over its unit squared.

        With the coefficient held `c` away from its least-squares value and all others fitted anew,
        the sum of squares is larger by the factor 1 + steepness c^2.
        """
        left = float(np.sum((self.target - self.matrix @ self.solve()) ** 2))
        own = float(np.sum(self.matrix[:, column] ** 2))
        return self.independence(column) * own / max(left, 1e-300)


def join(parts: Sequence[WeakRegression]) -> WeakRegression:
    """Return the equations of several recordings as one regression."""
    matrix = np.concatenate([part.matrix for part in parts])
    return WeakRegression(matrix, np.concatenate([part.target for part in parts]))


@dataclass(frozen=True)
class HannWindow:
    """The test function w of the weak form, moved along a recording by quarters of its length.

    The length is in samples from one end to the other, the time step in s.
    """

    time_step: float
    length: int

    def of_supply(self, values: FloatArray) -> FloatArray:
        """Return the integral of w r over each window, (time, ...) to (window, ...)."""
        return self._sums(values, self._weight)

    def of_store(self, values: FloatArray) -> FloatArray:
        """Return the integral of w' s over each window, (time, ...) to (window, ...)."""
        return self._sums(values, self.slope)

    def of_held(self, values: FloatArray) -> FloatArray:
        """Return the integral of w r_0, held from each sample to the next."""
        phase = self._phase
        area = phase / 2 - np.sin(2 * np.pi * phase) / (4 * np.pi)
        return self._sums(values[:-1], np.diff(area) * self.length * self.time_step)

    def of_transformed(self, values: FloatArray, matrices: FloatArray) -> FloatArray:
        """Return the integral of w M s + w' s, shape (window, state, coefficient).

        s is (time, state, coefficient), M a matrix of each sample, (time, state, state).
        """
        states, coefficients = values.shape[1:]
        along = self._windows(matrices, self.length + 1, self._stride)
        weights = along * self._weight + np.eye(states)[..., None] * self.slope
        rows = np.moveaxis(weights, -1, 2).reshape(len(weights), states, -1)
        each = values.reshape(-1, coefficients)
        columns = self._windows(each, states * (self.length + 1), states * self._stride)
        return np.asarray(rows @ columns.transpose(0, 2, 1))

    @property
    def _stride(self) -> int:
        return max(self.length // OVERLAP, 1)

    @property
    def _phase(self) -> FloatArray:
        return np.arange(self.length + 1) / self.length

    @property
    def _weight(self) -> FloatArray:
        return np.sin(np.pi * self._phase) ** 2 * self.time_step

    @property
    def slope(self) -> FloatArray:
        """Slope of w times the time step at each sample, (length + 1,), without a unit."""
        return np.pi / self.length * np.sin(2 * np.pi * self._phase)

    def _sums(self, values: FloatArray, weight: FloatArray) -> FloatArray:
        columns = np.ascontiguousarray(values).reshape(len(values), -1)
        windows = self._windows(columns, len(weight), self._stride)
        sums: FloatArray = weight @ windows.transpose(0, 2, 1)
        return sums.reshape(-1, *values.shape[1:])

    @staticmethod
    def _windows(values: FloatArray, length: int, stride: int) -> FloatArray:
        """Return a view of shape (window, ..., length)."""
        view = np.lib.stride_tricks.sliding_window_view(values, length, axis=0)
        return np.asarray(view[::stride])
