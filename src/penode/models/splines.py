"""Tensor-product cubic B-splines on a box with their Jacobian in closed form."""

import math
from collections.abc import Iterable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray, Leaf
from penode.errors import InputError
from penode.models.base import floats
from penode.models.parameters import coefficients


def _whole(values: Iterable[int]) -> tuple[int, ...]:
    return tuple(int(value) for value in values)


def cubic_kernel(t: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Return the cardinal cubic B-spline around zero and its slope, in the shape of t.

    B(t) = (max(2 - |t|, 0)^3 - 4 max(1 - |t|, 0)^3) / 6 (Unser, Splines: a perfect fit for signal
    and image processing, doi:10.1109/79.799930). At t = 0 the side is the right-hand one: the
    derivative of jnp.abs is zero there, which would make the curvature zero at every knot.
    """
    side = jnp.where(t < 0, -1.0, 1.0)
    outer, inner = jnp.maximum(2.0 - side * t, 0.0), jnp.maximum(1.0 - side * t, 0.0)
    return (outer**3 - 4.0 * inner**3) / 6.0, side * (2.0 * inner**2 - 0.5 * outer**2)


class Spline(eqx.Module):
    """Uniform cubic spline in n inputs on a box, twice continuously differentiable everywhere.

    The splines that reach into the box span every cubic polynomial there. Beyond the box the value
    falls to exactly zero within three cells, on purpose: below a
    `penode.models.compositions.LinearSkip` the map then continues linearly.

    All basis functions are evaluated, not only the 4^n that differ from zero: gathers of
    parameters with a batch axis are slow to differentiate.

    Attributes
    ----------
    low, high : tuple of n float
        Corners of the box, in the unit of the inputs.
    cells : tuple of n int
        Number of equal cells along each input.
    coefficients : array, shape (m, k_1, ..., k_n)
        k = cells + 3 along each input, centred at low + (j - 1) (high - low) / cells.

    Raises
    ------
    InputError
        If the box is empty or the shape of the coefficients does not fit the cells.
    """

    low: tuple[float, ...] = eqx.field(static=True, converter=floats)
    high: tuple[float, ...] = eqx.field(static=True, converter=floats)
    cells: tuple[int, ...] = eqx.field(static=True, converter=_whole)
    coefficients: Leaf = coefficients()

    def __check_init__(self) -> None:
        if not len(self.low) == len(self.high) == len(self.cells):
            raise InputError(
                f"low, high and cells must be one an input, got {self.low}, {self.high} and "
                f"{self.cells}."
            )
        if not all(0 < b - a < math.inf for a, b in zip(self.low, self.high, strict=True)):
            raise InputError(f"low must be below high, got a box from {self.low} to {self.high}.")
        if min(self.cells) < 1:
            raise InputError(f"cells must be >= 1 along each input, got {self.cells}.")
        wanted = tuple(count + 3 for count in self.cells)
        if self.coefficients.shape[1:] != wanted:
            raise InputError(
                f"coefficients must have shape {('m', *wanted)}, three more than cells along each "
                f"input, got {self.coefficients.shape}."
            )

    @classmethod
    def zero(
        cls, low: Sequence[float], high: Sequence[float], cells: Sequence[int], outputs: int
    ) -> "Spline":
        """Return the spline of m outputs with all coefficients zero."""
        shape = (outputs, *(count + 3 for count in cells))
        return cls(floats(low), floats(high), _whole(cells), np.zeros(shape))

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, n, batch) at x (n, batch)."""
        value: JaxArray = self.coefficients
        slopes: list[JaxArray] = []
        axes = zip(self.low, self.high, self.cells, x, strict=True)
        for basis, slope in [_basis(*axis) for axis in axes][::-1]:
            slopes = [_contract(rest, basis) for rest in slopes] + [_contract(value, slope)]
            value = _contract(value, basis)
        return value, jnp.stack(slopes[::-1], axis=1)


def _basis(low: float, high: float, cells: int, x: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Return the basis along one input at x (batch,) and its slope, both (k, batch)."""
    density = cells / (high - low)
    value, slope = cubic_kernel((x - low) * density - np.arange(-1, cells + 2)[:, None])
    return value, slope * density


def _contract(coefficients: JaxArray, basis: JaxArray) -> JaxArray:
    """Sum (..., k, batch or 1) times a basis (k, batch) over k."""
    return jnp.sum(coefficients * basis, axis=-2)
