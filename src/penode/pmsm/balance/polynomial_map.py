"""A flux map that is linear in its coefficients: gradients of a polynomial coenergy."""

from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray

#: Degree of the polynomial coenergy, and of the polynomials of a map without coenergy.
_DEGREE = {True: 8, False: 6}


@dataclass(frozen=True, eq=False)
class PolynomialMap:
    """Flux map that is linear in its coefficients, on currents scaled to the unit disc."""

    # Gradient of a polynomial coenergy, or two free polynomials.
    reciprocal: bool
    # A (peak).
    current_scale: float
    # Of the coenergy, or of the free polynomials; 8 and 6 if not given.
    degree: int | None = None

    def basis(self, currents: FloatArray) -> FloatArray:
        """Return the map of each coefficient, shape (time, 2, coefficient), at (time, 2) in A."""
        x, y = (currents / self.current_scale).T
        degree = self.degree or _DEGREE[self.reciprocal]
        of_x, of_y = (np.vander(one, degree + 1, increasing=True) for one in (x, y))
        m, n = np.array([(m, n) for m in range(degree + 1) for n in range(degree + 1 - m)]).T
        if not self.reciprocal:
            each = of_x[:, m] * of_y[:, n]
            return np.concatenate([np.stack([each, 0 * each], 1), np.stack([0 * each, each], 1)], 2)
        m, n = m[1:], n[1:]
        along_d = m * of_x[:, np.maximum(m - 1, 0)] * of_y[:, n]
        along_q = n * of_x[:, m] * of_y[:, np.maximum(n - 1, 0)]
        return np.stack([along_d, along_q], axis=1)

    def slopes(self, currents: FloatArray) -> FloatArray:
        """Return d psi / d i (time, 2, 2, coefficient), 1/A, of currents (time, 2), A.

        Flux linkage first, then the current; by central differences.
        """
        step = 1e-4 * self.current_scale
        shifts = step * np.eye(2)
        differences = [self.basis(currents + d) - self.basis(currents - d) for d in shifts]
        return np.stack(differences, axis=2) / (2 * step)
