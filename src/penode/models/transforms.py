"""Smooth bijections from the optimiser's raw numbers to admissible values of a parameter."""

import math
from dataclasses import dataclass
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray


class Transform(Protocol):
    """A smooth bijection between a raw vector and a parameter's admissible values."""

    def size(self, shape: tuple[int, ...]) -> int:
        """Return the length of the raw vector of a value of this shape."""

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Map raw (size,) to a value (*shape)."""

    def inverse(self, value: FloatArray) -> FloatArray:
        """Map a value (*shape) to raw (size,)."""


class _EntryByEntry:
    def size(self, shape: tuple[int, ...]) -> int:
        """Return the number of entries."""
        return math.prod(shape)


@dataclass(frozen=True)
class Identity(_EntryByEntry):
    """Any real value."""

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Reshape raw (size,) to (*shape)."""
        return raw.reshape(shape)

    def inverse(self, value: FloatArray) -> FloatArray:
        """Flatten the value."""
        return np.ravel(value)


@dataclass(frozen=True)
class Positive(_EntryByEntry):
    """Values above zero, as exponentials."""

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Exponentiate raw (size,), at least to the smallest number above zero."""
        return jnp.maximum(jnp.exp(raw), np.finfo(raw.dtype).tiny).reshape(shape)

    def inverse(self, value: FloatArray) -> FloatArray:
        """Take the logarithm of the value."""
        return np.log(np.ravel(value))


@dataclass(frozen=True)
class Bounded(_EntryByEntry):
    """Values strictly between two bounds, as logistic functions.

    Attributes
    ----------
    low, high : float
        In the parameter's SI unit.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"low must be below high, got {self.low} and {self.high}.")

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Squeeze raw (size,) between the bounds, a rounding error away from them at most."""
        rounding = 4 * np.finfo(raw.dtype).eps
        place = jnp.clip(jax.nn.sigmoid(raw), rounding, 1 - rounding)
        return (self.low + (self.high - self.low) * place).reshape(shape)

    def inverse(self, value: FloatArray) -> FloatArray:
        """Take the logit of the value's place between the bounds."""
        place = (np.ravel(value) - self.low) / (self.high - self.low)
        return np.log(place) - np.log1p(-place)


@dataclass(frozen=True)
class PositiveDefinite:
    """Symmetric positive definite matrices, as Cholesky factors with a logarithmic diagonal."""

    def size(self, shape: tuple[int, ...]) -> int:
        """Return the number of entries of one triangle."""
        return shape[0] * (shape[0] + 1) // 2

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Build F F' (n, n) from raw (size,), the rows of the lower triangle F."""
        n = shape[0]
        factor = jnp.zeros(shape, raw.dtype).at[np.tril_indices(n)].set(raw)
        diagonal = jnp.diag_indices(n)
        factor = factor.at[diagonal].set(jnp.exp(factor[diagonal]))
        return factor @ factor.T

    def inverse(self, value: FloatArray) -> FloatArray:
        """Return the lower triangle of the Cholesky factor, its diagonal as logarithms.

        A matrix that is singular to rounding, as `forward` may return one, counts as definite.
        """
        eigenvalues = np.linalg.eigvalsh(value)
        rounding = 4 * len(value) * np.finfo(np.float64).eps * eigenvalues[-1]
        if abs(eigenvalues[0]) < rounding:
            value = value + 2 * rounding * np.eye(len(value))
        factor = np.linalg.cholesky(value)
        np.fill_diagonal(factor, np.log(np.diag(factor)))
        return np.asarray(factor[np.tril_indices(len(factor))])
