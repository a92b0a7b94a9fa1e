"""Small networks with their scaling inside and their Jacobian in closed form.

Weights carry a trailing batch axis inside compiled code (see `penode.models.base.Model`), so
products are written as broadcast sums, which compile to one fused loop over the batch.
"""

import functools
import operator
from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray, Leaf
from penode.models.parameters import parameter
from penode.models.transforms import Positive, PositiveDefinite

#: Rows and columns from which weights that all columns share are one matrix product.
_WIDE = 16


def dense(weights: JaxArray, x: JaxArray) -> JaxArray:
    """Multiply weights (m, n, batch or 1) with columns x (n, batch) or matrices x (n, k, batch)."""
    if weights.shape[-1] == 1:
        if min(weights.shape[:2]) >= _WIDE or weights.shape[1] >= 2 * _WIDE:
            return jnp.tensordot(weights[..., 0], x, axes=1)
        return _sum_of_products(weights, x)
    if x.ndim == 2:
        return jnp.sum(weights * x[None], axis=1)
    return jnp.sum(weights[:, :, None] * x[None], axis=1)


def _sum_of_products(weights: JaxArray, x: JaxArray) -> JaxArray:
    """Multiply weights that all columns share: products added one by one fuse in reverse mode."""
    apart = [1] * len(x)
    columns = jax.lax.split(weights, apart, axis=1)
    rows = jax.lax.split(x, apart, axis=0)
    shape = (len(weights), *(1,) * (x.ndim - 1))
    products = [c.reshape(shape) * row for c, row in zip(columns, rows, strict=True)]
    return functools.reduce(operator.add, products)


class FeatureNetwork(eqx.Module):
    """A learned map that features, such as the harmonics of an angle, can change."""

    # Whether the mean over features of mean zero is the map without features.
    linear_in_features: ClassVar[bool] = False

    def value_and_jacobian(
        self, x: JaxArray, features: JaxArray | None = None
    ) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, n, batch) at x (n, batch).

        That and features, (feature, batch or 1), zero if not given, are dimensionless.
        """
        raise NotImplementedError


class TanhLayers(FeatureNetwork):
    """Fully connected network with tanh hidden layers and a linear output layer.

    Features, such as the harmonics of an angle, are further inputs, after those of the map.

    Attributes
    ----------
    weights, biases : tuple of arrays, shapes (n_out, n_in) and (n_out,)
        One of each a layer, dimensionless.
    """

    weights: tuple[Leaf, ...]
    biases: tuple[Leaf, ...]

    @classmethod
    def random(cls, sizes: Sequence[int], seed: int) -> "TanhLayers":
        """Draw uniform weights in +-1/sqrt(n_in) (the common default of deep-learning libraries).

        Parameters
        ----------
        sizes : sequence of int
            Neurons a layer, inputs first: ``(2, 6, 4, 2)`` is the paper's network.
        seed : int
            Seed of the draw.
        """
        random = np.random.default_rng(seed)
        weights, biases = [], []
        for n_in, n_out in pairwise(sizes):
            bound = 1.0 / np.sqrt(n_in)
            weights.append(random.uniform(-bound, bound, (n_out, n_in)))
            biases.append(random.uniform(-bound, bound, n_out))
        return cls(tuple(weights), tuple(biases))

    def value_and_jacobian(
        self, x: JaxArray, features: JaxArray | None = None
    ) -> tuple[JaxArray, JaxArray]:
        """Return the output (m, batch) and its Jacobian (m, n, batch)."""
        first, n = self.weights[0], len(x)
        apart = first.shape[1] > n
        inner = first[:, :n] if apart else first
        shift = self.biases[0]
        if apart and features is not None:
            shift = shift + dense(first[:, n:], features)
        hidden = jnp.tanh(dense(inner, x) + shift)
        slope = inner * (1.0 - hidden**2)[:, None]
        for weights, bias in zip(self.weights[1:-1], self.biases[1:-1], strict=True):
            hidden = jnp.tanh(dense(weights, hidden) + bias)
            slope = dense(weights, slope) * (1.0 - hidden**2)[:, None]
        return dense(self.weights[-1], hidden) + self.biases[-1], dense(self.weights[-1], slope)


class ConvexGradient(FeatureNetwork):
    """Gradient of a strictly convex scalar: offset + stiffness x + A' (gain * tanh(A x + bias)).

    The scalar is offset'x + x' stiffness x / 2 + sum(gain * log cosh(A x + bias)). With a positive
    definite stiffness and positive gains its Hessian is symmetric positive definite everywhere,
    so the map is invertible (gradient networks, arXiv:2602.14947). Features, such as the harmonics
    of an angle, may shift the biases by ``modulation @ features``: at each of their values the map
    is still the gradient of such a scalar.

    Attributes
    ----------
    offset : array, shape (n,)
    stiffness : array, shape (n, n), symmetric positive definite
    directions : array, shape (unit, n)
        The matrix A.
    bias : array, shape (unit,)
    gain : array, shape (unit,), positive
    modulation : array, shape (unit, feature), or None
        Shift of the biases by each feature; None where the map has no features.
    """

    offset: Leaf = parameter()
    stiffness: Leaf = parameter(transform=PositiveDefinite())
    directions: Leaf = parameter()
    bias: Leaf = parameter()
    gain: Leaf = parameter(transform=Positive())
    modulation: Leaf | None = parameter(default=None)

    @classmethod
    def random(cls, inputs: int, units: int, seed: int, features: int = 0) -> "ConvexGradient":
        """Draw directions of random angle and length 1 to 3, with biases inside the unit ball.

        Parameters
        ----------
        inputs, units : int
            Sizes n and unit.
        seed : int
            Seed of the draw.
        features : int
            Number of features; their shifts of the biases are drawn small, normal of 0.01.
        """
        random = np.random.default_rng(seed)
        directions = random.normal(size=(units, inputs))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        length = random.uniform(1.0, 3.0, units)
        bias = random.uniform(-0.8, 0.8, units) * length
        gain = np.full(units, 0.3 / units)
        stiffness = 0.3 * np.eye(inputs)
        shifts = 0.01 * random.normal(size=(units, features)) if features else None
        directions *= length[:, None]
        return cls(np.zeros(inputs), stiffness, directions, bias, gain, shifts)

    def value_and_jacobian(
        self, x: JaxArray, features: JaxArray | None = None
    ) -> tuple[JaxArray, JaxArray]:
        """Return the gradient (n, batch) and the Hessian (n, n, batch)."""
        hidden = dense(self.directions, x) + self.bias
        if features is not None and self.modulation is not None:
            hidden += dense(self.modulation, features)
        saturation = jnp.tanh(hidden)
        rate = self.gain * saturation
        slope = self.gain * (1.0 - saturation**2)
        gradient = self.offset + dense(self.stiffness, x)
        gradient += jnp.sum(self.directions * rate[:, None], axis=0)
        outer = self.directions[:, :, None] * self.directions[:, None]
        return gradient, self.stiffness + jnp.sum(outer * slope[:, None, None], axis=0)
