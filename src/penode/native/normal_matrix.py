"""The sum of products of sensitivities, S'S, one batch of windows at a time."""

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.native import library


def add_products(normal: JaxArray, slopes: JaxArray) -> JaxArray:
    """Add the products of each output's and window's slopes; read it by `whole`.

    Parameters
    ----------
    normal : array, shape (value, value)
        On and below the diagonal.
    slopes : array, shape (output, value, batch)
    """
    if normal.dtype != np.float64 or not library.available():
        return _plain(normal, slopes)
    added: JaxArray = jax.lax.platform_dependent(normal, slopes, cpu=_in_c, default=_plain)
    return added


def whole(normal: JaxArray) -> JaxArray:
    """Return the symmetric matrix of which the part on and below the diagonal came."""
    return jnp.tril(normal) + jnp.tril(normal, -1).T


def _plain(normal: JaxArray, slopes: JaxArray) -> JaxArray:
    return normal + jnp.einsum("oib,ojb->ij", slopes, slopes)


def _in_c(normal: JaxArray, slopes: JaxArray) -> JaxArray:
    shape = jax.ShapeDtypeStruct(normal.shape, normal.dtype)
    call = jax.ffi.ffi_call("penode_add_products", shape, input_output_aliases={0: 0})
    added: JaxArray = call(normal, slopes)
    return added
