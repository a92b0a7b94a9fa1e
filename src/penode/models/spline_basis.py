"""B-splines in one variable on knots that lie densest around zero, with three derivatives."""

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.errors import InputError

#: The second derivative of such a spline, an inductance, still has a continuous slope.
DEGREE = 4


@dataclass(frozen=True)
class SplineBasis:
    """Quartic B-splines on -1 .. 1, continued beyond by the parabola that touches at the end.

    The knots are warped by a hyperbolic sine: saturation bends a flux map most near zero current.
    C. de Boor, A Practical Guide to Splines, Springer 2001, chapter X.

    Attributes
    ----------
    count : int
        Number of functions; there are count - 4 cells.
    sharpness : float
        Knots lie evenly over asinh(x / sharpness): the smaller, the denser around zero.

    Raises
    ------
    InputError
        If there are fewer than 5 functions, or the sharpness is not above 0.
    """

    count: int
    sharpness: float

    def __post_init__(self) -> None:
        if self.count <= DEGREE or not self.sharpness > 0:
            raise InputError(
                f"a basis of {self.count} splines with sharpness {self.sharpness} came; want at "
                f"least {DEGREE + 1} and a sharpness above 0."
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

    def __call__(self, x: JaxArray) -> JaxArray:
        """Return the splines and their first two derivatives, shape (3, count, batch).

        Parameters
        ----------
        x : array, shape (batch,)
        """
        return _splines(self, x)

    def derivatives(self, x: FloatArray) -> FloatArray:
        """Return the splines and their first three derivatives, shape (4, count, point), by NumPy.

        Parameters
        ----------
        x : ndarray, shape (point,)
        """
        return np.stack(_derivatives(self, x, np))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _splines(basis: SplineBasis, x: JaxArray) -> JaxArray:
    return jnp.stack(_derivatives(basis, x)[:3])


@_splines.defjvp
def _splines_jvp(
    basis: SplineBasis, primals: tuple[JaxArray], tangents: tuple[JaxArray]
) -> tuple[JaxArray, JaxArray]:
    """Take the slope of each derivative from the next one: no recursion is differentiated."""
    every = _derivatives(basis, primals[0])
    return jnp.stack(every[:3]), jnp.stack(every[1:]) * tangents[0]


def _derivatives(basis: SplineBasis, x: Any, numerics: Any = jnp) -> list[Any]:
    """Return the splines and three derivatives, each (count, batch): divided differences."""
    inside = numerics.clip(x, -1.0, 1.0)
    count, knots = basis.count, basis.knots[:, None]
    reached = (inside >= knots[:count]) & (inside < knots[DEGREE + 1 :])
    found = []
    for order, factor in enumerate((1.0, -4.0, 12.0, -24.0)):
        powers = numerics.maximum(knots - inside, 0.0) ** (DEGREE - order)
        pieces = [
            factor * basis.weights[:, k, None] * powers[k : k + count] for k in range(DEGREE + 2)
        ]
        found.append(numerics.where(reached, sum(pieces[1:], pieces[0]), 0.0))
    value, slope, curvature, third = found
    beyond = x - inside
    return [
        value + beyond * (slope + beyond * curvature / 2),
        slope + beyond * curvature,
        curvature,
        numerics.where(beyond == 0.0, third, 0.0),
    ]
