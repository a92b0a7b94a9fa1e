"""Flux maps that are linear in their coefficients: polynomial, radial and spline bases."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf, float64, on_device
from penode.errors import InputError
from penode.models.base import LearnedMap
from penode.models.parameters import parameter, with_batch_axis
from penode.models.polynomials import exponents
from penode.models.splines import Spline

#: Half the side of the square that a basis covers, in the largest current recorded.
_REACH = 1.0


@dataclass(frozen=True, eq=False)
class LinearMap:
    """A map that is linear in its coefficients."""

    name: str
    # Basis functions of one flux linkage.
    terms: int
    # Weights (output, term) to the map that sums them, on currents scaled to order 1.
    network: Callable[[FloatArray], LearnedMap]
    # Weights (2 term, coefficient) of psi_d, then psi_q; None: a coefficient for each.
    constraint: FloatArray | None = None

    @property
    def coefficients(self) -> int:
        """Number of coefficients."""
        return 2 * self.terms if self.constraint is None else self.constraint.shape[1]

    def columns(self, x: FloatArray) -> FloatArray:
        """Return the flux linkages (time, 2, coefficient), dimensionless, of each coefficient.

        The currents (time, 2) are over the largest one.
        """
        # With the identity for weights a map's outputs are its basis functions.
        network = self.network(np.eye(self.terms))
        with float64():
            basis = np.asarray(_evaluate(network, on_device(x.T))).T
        nothing = np.zeros_like(basis)
        psi_d, psi_q = np.hstack([basis, nothing]), np.hstack([nothing, basis])
        both = np.stack([psi_d, psi_q], axis=1)
        return both if self.constraint is None else np.asarray(both @ self.constraint)

    def weighted(self, coefficients: FloatArray) -> LearnedMap:
        """Return the map (2 inputs, 2 outputs) of given coefficients, in the order of `columns`."""
        weights = coefficients if self.constraint is None else self.constraint @ coefficients
        return self.network(weights.reshape(2, self.terms))


@eqx.filter_jit
def _evaluate(network: LearnedMap, x: JaxArray) -> JaxArray:
    batched: LearnedMap = with_batch_axis(network)
    return batched.value_and_jacobian(x)[0]


class Monomials(eqx.Module):
    """All monomials of two inputs up to a total degree, weighted and summed.

    The products are gathered from tables of powers: a few array operations, whatever the
    degree.
    """

    degree: int = eqx.field(static=True)
    # (m, term), one column a monomial, in the order of `polynomials.exponents`.
    coefficients: Leaf = parameter()

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, 2, batch) at x (2, batch)."""
        first, second = np.array(exponents(2, self.degree)).T
        powers = jnp.stack([x**n for n in range(self.degree + 1)])  # (power, input, batch)
        by_first, by_second = powers[first, 0], powers[second, 1]
        slopes = (
            first[:, None] * powers[np.maximum(first - 1, 0), 0] * by_second,
            by_first * second[:, None] * powers[np.maximum(second - 1, 0), 1],
        )
        return _weigh(self.coefficients, by_first * by_second, jnp.stack(slopes, axis=1))


class RadialBasis(eqx.Module):
    """Gaussians on a square grid beside a constant and a linear part.

    ``sum_c w_c exp(-|x - c|^2 / (2 width^2)) + w_0 + w_1 x_1 + w_2 x_2``
    """

    # Centres along each side of the square from -1 to 1.
    points: int = eqx.field(static=True)
    # Standard deviation of the Gaussians, in the unit of the inputs.
    width: float = eqx.field(static=True)
    # (m, points^2 + 3), of the Gaussians, row by row, of 1, x_1 and x_2.
    coefficients: Leaf = parameter()

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, 2, batch) at x (2, batch)."""
        axis = np.linspace(-_REACH, _REACH, self.points)
        centres = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        gap = (x[None] - centres[..., None]) / self.width
        bell = jnp.exp(-0.5 * jnp.sum(gap**2, axis=1))
        straight = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])[..., None]
        slopes = (
            -bell[:, None] * gap / self.width,
            jnp.broadcast_to(straight, (3, *x.shape)),
        )
        value = jnp.concatenate([bell, jnp.ones_like(x[:1]), x])
        return _weigh(self.coefficients, value, jnp.concatenate(slopes))


def _weigh(coefficients: JaxArray, value: JaxArray, slopes: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Sum basis functions (term, batch) and slopes (term, 2, batch) by (m, term, batch or 1)."""
    return (
        jnp.sum(coefficients * value, axis=1),
        jnp.sum(coefficients[:, :, None] * slopes, axis=1),
    )


def polynomial(degree: int = 6, reciprocal: bool = False) -> LinearMap:
    """Return all monomials of the currents up to a total degree of the flux linkages.

    If reciprocal, both are the slopes of one coenergy, of one degree more.
    """
    _at_least(degree, 1, "degree")
    monomials = exponents(2, degree)
    network = partial(Monomials, degree)
    if not reciprocal:
        return LinearMap("polynomial", len(monomials), network)
    return coenergy_polynomial(degree + 1, mirrored=False)


def coenergy_polynomial(degree: int = 8, mirrored: bool = True) -> LinearMap:
    """Return the slopes of all monomials of a coenergy up to a total degree.

    If mirrored, it is even in i_q, as that of a machine that is symmetric about its d axis.
    """
    _at_least(degree, 2, "degree")
    monomials = exponents(2, degree - 1)
    # A constant has no slope.
    coenergy = [p for p in exponents(2, degree)[1:] if not (mirrored and p[1] % 2)]
    slopes = np.zeros((2, len(monomials), len(coenergy)))
    for column, powers in enumerate(coenergy):
        for axis, power in enumerate(powers):
            if power:
                lowered = tuple(p - (k == axis) for k, p in enumerate(powers))
                slopes[axis, monomials.index(lowered), column] = power
    constraint = slopes.reshape(2 * len(monomials), -1)
    network = partial(Monomials, degree - 1)
    return LinearMap("reciprocal polynomial", len(monomials), network, constraint)


def radial(points: int = 6) -> LinearMap:
    """Return Gaussians on a square grid, as wide as its spacing, and a linear part."""
    _at_least(points, 2, "points")
    width = 2 * _REACH / (points - 1)
    return LinearMap("radial", points**2 + 3, partial(RadialBasis, points, width))


def spline(cells: int = 4) -> LinearMap:
    """Return cubic B-splines on a square, cells along each side."""
    _at_least(cells, 1, "cells")
    side, reach = cells + 3, (_REACH, _REACH)

    def network(weights: FloatArray) -> LearnedMap:
        shaped = weights.reshape(len(weights), side, side)
        return Spline((-_REACH, -_REACH), reach, (cells, cells), shaped)

    return LinearMap("spline", side**2, network)


def _at_least(count: int, least: int, what: str) -> None:
    if count < least:
        raise InputError(f"{what} must be >= {least}, got {count}.")
