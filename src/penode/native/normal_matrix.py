"""The sum of products of sensitivities, S'S, one batch of windows at a time."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.native import library


class NormalMatrix(NamedTuple):
    """S'S, growing, (value, value), on and below the diagonal.

    ``wanted`` is an int32, 0 where nothing is to be added: a third of an evaluation that needs S'r
    alone.
    """

    lower: JaxArray
    wanted: JaxArray

    @classmethod
    def zero(cls, size: int, like: JaxArray, wanted: JaxArray | int = 1) -> "NormalMatrix":
        """Return the matrix (size, size) before anything was added, of another array's type."""
        return cls(jnp.zeros((size, size), like.dtype), jnp.asarray(wanted, jnp.int32))

    def plus(self, slopes: JaxArray) -> "NormalMatrix":
        """Add the products of each output's and window's slopes (output, value, batch)."""
        return self._replace(lower=_added(self.lower, self.wanted, slopes))

    def minus(self, slopes: JaxArray) -> "NormalMatrix":
        """Take the products of slopes (output, value, batch) away."""
        return self._replace(lower=_added(self.lower, -self.wanted, slopes))

    @property
    def whole(self) -> JaxArray:
        """Both sides of the diagonal, shape (value, value)."""
        return jnp.tril(self.lower) + jnp.tril(self.lower, -1).T


def _added(lower: JaxArray, sign: JaxArray, slopes: JaxArray) -> JaxArray:
    """Add -1, 0 or 1 times the products of slopes."""
    if lower.dtype != np.float64 or not library.available():
        return _plain(lower, sign, slopes)
    added: JaxArray = jax.lax.platform_dependent(lower, sign, slopes, cpu=_in_c, default=_plain)
    return added


def _plain(lower: JaxArray, sign: JaxArray, slopes: JaxArray) -> JaxArray:
    def added(lower: JaxArray, slopes: JaxArray) -> JaxArray:
        return lower + sign * jnp.einsum("oib,ojb->ij", slopes, slopes)

    sums: JaxArray = jax.lax.cond(sign != 0, added, lambda lower, _: lower, lower, slopes)
    return sums


def _in_c(lower: JaxArray, sign: JaxArray, slopes: JaxArray) -> JaxArray:
    shape = jax.ShapeDtypeStruct(lower.shape, lower.dtype)
    call = jax.ffi.ffi_call("penode_add_products", shape, input_output_aliases={0: 0})
    added: JaxArray = call(lower, sign, slopes)
    return added
