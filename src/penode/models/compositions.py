"""Maps made of maps: a linear or quadratic part beside one, a gradient, scales around one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray, Leaf
from penode.errors import InputError
from penode.models.base import LearnedMap, floats
from penode.models.networks import dense
from penode.models.parameters import parameter
from penode.models.transforms import PositiveDefinite


class LinearSkip(eqx.Module):
    """A map beside a linear one: network(x) + matrix x + offset.

    Where the network says nothing, as a `penode.models.splines.Spline` beyond its box, the sum
    continues linearly. A network that can be linear itself shares that part with the matrix, so
    the two are distinguished by the sum only. The sum is reciprocal where network and matrix are.

    Attributes
    ----------
    network : LearnedMap
        n inputs, m outputs.
    matrix : array, shape (m, n)
    offset : array, shape (m,)
    """

    network: LearnedMap
    matrix: Leaf = parameter()
    offset: Leaf = parameter()

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, n, batch) at x (n, batch)."""
        value, jacobian = self.network.value_and_jacobian(x)
        return value + dense(self.matrix, x) + self.offset, jacobian + self.matrix


class QuadraticSkip(eqx.Module):
    """A potential beside a convex quadratic one: network(x) + linear x + x' matrix x / 2.

    Under a `Gradient` it is the linear, reciprocal part of a map, which goes on where the network,
    of n inputs and one output, says nothing; linear is (n,), matrix (n, n), positive definite.
    """

    network: LearnedMap
    linear: Leaf = parameter()
    matrix: Leaf = parameter(transform=PositiveDefinite())

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (1, batch) and its Jacobian (1, n, batch) at x (n, batch)."""
        value, jacobian = self.network.value_and_jacobian(x)
        slope = dense(self.matrix, x)
        quadratic = jnp.sum((self.linear + slope / 2) * x, axis=0)
        return value + quadratic, jacobian + self.linear + slope


class Gradient(eqx.Module):
    """Gradient of a map with one output: its Jacobian is a Hessian, so it is reciprocal.

    The constant of the potential has no effect.

    Attributes
    ----------
    potential : LearnedMap
        n inputs, one output, twice differentiable.
    """

    potential: LearnedMap

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the gradient (n, batch) and the Hessian (n, n, batch) at x (n, batch).

        The gradient is the potential's closed form, the Hessian its forward derivative.
        """
        inputs = x.shape[0]
        units = jnp.eye(inputs, dtype=x.dtype)[:, :, None]
        pairs = [
            jax.jvp(self._gradient, (x,), (jnp.broadcast_to(unit, x.shape),)) for unit in units
        ]
        return pairs[0][0], jnp.stack([column for _, column in pairs], axis=1)

    def _gradient(self, x: JaxArray) -> JaxArray:
        slopes = self.potential.value_and_jacobian(x)[1]
        if slopes.shape[0] != 1:
            raise InputError(
                f"a potential must have one output, got a {type(self.potential).__name__} with "
                f"{slopes.shape[0]}."
            )
        return slopes[0]


class Scaled(eqx.Module):
    """A map with its scales inside: output_scale * network(x / input_scale).

    Attributes
    ----------
    network : LearnedMap
        n inputs, m outputs, of order 1.
    input_scale : tuple of n float
        One unit of each of the network's inputs, in the unit of x.
    output_scale : tuple of m float
        One unit of each of the network's outputs, in the unit of the value.

    Raises
    ------
    InputError
        If a scale is zero or not finite.
    """

    network: LearnedMap
    input_scale: tuple[float, ...] = eqx.field(static=True, converter=floats)
    output_scale: tuple[float, ...] = eqx.field(static=True, converter=floats)

    def __check_init__(self) -> None:
        scales = np.array([*self.input_scale, *self.output_scale])
        if not np.isfinite(scales).all() or (scales == 0).any():
            raise InputError(
                f"scales must be finite and not 0, got {self.input_scale} and {self.output_scale}."
            )

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, n, batch) at x (n, batch)."""
        inner = _column(self.input_scale, x.shape[0], "input")
        value, jacobian = self.network.value_and_jacobian(x / inner)
        outer = _column(self.output_scale, value.shape[0], "output")
        return outer * value, (outer[:, None] / inner) * jacobian


def _column(scale: tuple[float, ...], count: int, side: str) -> JaxArray:
    if len(scale) != count:
        raise InputError(f"{side}_scale must be {count} numbers, one an {side}, got {scale}.")
    return jnp.array(scale)[:, None]
