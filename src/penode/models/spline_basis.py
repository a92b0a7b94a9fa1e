"""B-splines in one variable on knots that lie densest around zero, with three derivatives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.errors import InputError

#: The second derivative of such a spline, an inductance, still has a continuous slope.
DEGREE = 4


@dataclass(frozen=True)
class SplineBasis:
    """Quartic B-splines on -1 .. 1, continued beyond by the parabola that touches at the end.

    Knots lie evenly over asinh(x / sharpness), the denser around zero the smaller it is: saturation
    bends a flux map most near zero current. `count` functions have count - 4 cells (C. de Boor, A
    Practical Guide to Splines, Springer 2001, chapter X).
    """

    count: int
    sharpness: float

    def __post_init__(self) -> None:
        if self.count <= DEGREE or not self.sharpness > 0:
            raise InputError(
                f"a basis must have at least {DEGREE + 1} splines and a sharpness above 0, got "
                f"{self.count} and {self.sharpness}."
            )

    @cached_property
    def breaks(self) -> FloatArray:
        """Ends of the cells, shape (cell + 1,)."""
        even = np.linspace(-1.0, 1.0, self.count - DEGREE + 1)
        warped = self.sharpness * np.sinh(math.asinh(1 / self.sharpness) * even)
        return np.asarray(warped / warped[-1])

    @cached_property
    def knots(self) -> FloatArray:
        """Breaks with four more beyond each end, as far apart as the last, shape (count + 5,)."""
        beyond = (self.breaks[-1] - self.breaks[-2]) * np.arange(1, DEGREE + 1)
        return np.concatenate([-1.0 - beyond[::-1], self.breaks, 1.0 + beyond])

    @cached_property
    def weights(self) -> FloatArray:
        """Of (t - x)^4 at a spline's six knots t, where they lie above x, shape (count, 6)."""
        first = np.arange(self.count)[:, None]
        knots = self.knots[first + np.arange(DEGREE + 2)]
        apart = knots[:, :, None] - knots[:, None] + np.eye(DEGREE + 2)
        width: FloatArray = knots[:, -1:] - knots[:, :1]
        return np.asarray(width / np.prod(-apart, axis=2))

    def quadrature(self, points: int = 5) -> tuple[FloatArray, FloatArray]:
        """Return places and weights, each (place,), that integrate products of the splines."""
        x, w = np.polynomial.legendre.leggauss(points)
        half = np.diff(self.breaks)[:, None] / 2
        middle = (self.breaks[1:] + self.breaks[:-1])[:, None] / 2
        return (middle + half * x).ravel(), (half * w).ravel()

    def derivatives(self, x: FloatArray) -> FloatArray:
        """Return the splines and their first three derivatives, (4, count, point), by NumPy."""
        inside = np.clip(x, -1.0, 1.0)
        cell = np.searchsorted(self.breaks[1:-1], inside, side="right")
        t, beyond = inside - self.breaks[cell], x - inside
        c0, c1, c2, c3, c4 = self.pieces[:, :, cell]
        value = c0 + t * (c1 + t * (c2 + t * (c3 + t * c4)))
        slope = c1 + t * (2 * c2 + t * (3 * c3 + t * (4 * c4)))
        curvature = 2 * c2 + t * (6 * c3 + t * (12 * c4))
        third = np.where(beyond == 0.0, 6 * c3 + t * (24 * c4), 0.0)
        value, slope = value + beyond * (slope + beyond * curvature / 2), slope + beyond * curvature
        every = np.zeros((4, self.count, len(x)))
        for k in range(DEGREE + 1):
            every[:, cell + k, np.arange(len(x))] = value[k], slope[k], curvature[k], third[k]
        return every

    @cached_property
    def pieces(self) -> FloatArray:
        """Polynomials of each cell over the distance from its left end, (power, spline, cell).

        Of the splines, those five that are not zero in the cell.
        """
        axis = self.knots[None, :, None], self.weights[None]
        left, right = (
            _derivatives(*axis, ends[None], 4, np)[:, 0]
            for ends in (self.breaks[:-1], self.breaks[1:])
        )
        fourth = (right[3] - left[3]) / np.diff(self.breaks)
        powers = np.stack([*left, fourth]) / np.array([1.0, 1.0, 2.0, 6.0, 24.0])[:, None, None]
        cells = np.arange(len(self.breaks) - 1)
        return np.asarray(powers[:, cells + np.arange(DEGREE + 1)[:, None], cells])


def splines_of_each(bases: Sequence[SplineBasis], x: JaxArray, count: int = 3) -> JaxArray:
    """Return splines and derivatives along several axes, shape (derivative, axis, spline, batch).

    There is one basis an axis, with equally many functions, and x is (axis, batch). `count` is how
    many: the splines, their slopes, and so on; at most 4.
    """
    knots = np.stack([basis.knots for basis in bases])[..., None]
    weights = np.stack([basis.weights for basis in bases])
    return cast(JaxArray, _derivatives(knots, weights, x, count, jnp))


def _derivatives(knots: FloatArray, weights: FloatArray, x: Any, count: int, numerics: Any) -> Any:
    """Return divided differences of truncated powers: knots (axis, knot, 1), x (axis, point)."""
    x = x[:, None]
    inside = numerics.clip(x, -1.0, 1.0)
    splines = weights.shape[1]
    reached = (inside >= knots[:, :splines]) & (inside < knots[:, DEGREE + 1 :])
    above = numerics.maximum(knots - inside, 0.0)
    square = above * above
    powers = numerics.stack([square * square, square * above, square, above])
    factors = np.array([1.0, -4.0, 12.0, -24.0])[:, None, None, None] * weights
    pieces = [factors[..., k, None] * powers[:, :, k : k + splines] for k in range(DEGREE + 2)]
    differences = numerics.where(reached, sum(pieces[1:], pieces[0]), 0.0)
    value, slope, curvature, third = differences
    beyond = x - inside
    continued = [
        value + beyond * (slope + beyond * curvature / 2),
        slope + beyond * curvature,
        curvature,
        numerics.where(beyond == 0.0, third, 0.0),
    ]
    return numerics.stack(continued[:count])
