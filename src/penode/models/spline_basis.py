"""B-splines in one variable on knots that lie densest around zero, with three derivatives."""

import math
from dataclasses import dataclass
from functools import cached_property, partial

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
        """Breaks with the ends repeated, shape (count + 5,)."""
        return np.concatenate([np.full(DEGREE, -1.0), self.breaks, np.full(DEGREE, 1.0)])

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

    def third(self, x: JaxArray) -> JaxArray:
        """Return the third derivatives, shape (count, batch), at x (batch,)."""
        return _derivatives(self, x)[3]


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


def _derivatives(basis: SplineBasis, x: JaxArray) -> list[JaxArray]:
    """Return the splines and three derivatives, each (count, batch), by de Boor's recursion."""
    inside = jnp.clip(x, -1.0, 1.0)
    levels = _levels(basis.knots, inside)
    found: list[JaxArray] = []
    for order in range(4):
        functions = levels[DEGREE - order]
        for degree in range(DEGREE - order + 1, DEGREE + 1):
            over = degree * _reciprocals(basis.knots, degree)[:, None]
            functions = jnp.asarray(over[:-1] * functions[:-1] - over[1:] * functions[1:])
        found.append(functions)
    value, slope, curvature, third = found
    beyond = x - inside
    return [
        value + beyond * (slope + beyond * curvature / 2),
        slope + beyond * curvature,
        curvature,
        jnp.where(beyond == 0.0, third, 0.0),
    ]


def _levels(knots: FloatArray, x: JaxArray) -> list[JaxArray]:
    """Return the B-splines of each degree 0 .. 4 on all knots, at x (batch,) within them."""
    last = len(knots) - DEGREE - 2  # the cell that holds the upper end
    lower, upper = knots[:-1, None].copy(), knots[1:, None].copy()
    upper[last] = np.inf
    lower[last + 1 :] = np.inf
    levels = [jnp.where((x >= lower) & (x < upper), 1.0, 0.0).astype(x.dtype)]
    for degree in range(1, DEGREE + 1):
        over = _reciprocals(knots, degree)[:, None]
        rising = (x - knots[: len(over), None]) * over
        below = levels[-1]
        levels.append(rising[:-1] * below[:-1] + (1.0 - rising[1:]) * (over[1:] > 0) * below[1:])
    return levels


def _reciprocals(knots: FloatArray, degree: int) -> FloatArray:
    """Return 1 / (t_(i + degree) - t_i), zero where knots coincide."""
    width = knots[degree:] - knots[:-degree]
    return np.where(width > 0, 1.0 / np.where(width > 0, width, 1.0), 0.0)
