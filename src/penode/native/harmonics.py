"""Cosines and sines of multiples of an angle, computed once.

XLA would compute them again in every loop that reads them: they took a third of an evaluation.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.native import library


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def harmonics(orders: tuple[int, ...], angle: JaxArray) -> JaxArray:
    """Return cos(n angle) of each order n, then sin, (2 order, batch), at angles (batch,), rad."""
    if angle.dtype != np.float64 or not library.available():
        return _plain(angle, orders=orders)
    waves: JaxArray = jax.lax.platform_dependent(
        angle, cpu=partial(_in_c, orders=orders), default=partial(_plain, orders=orders)
    )
    return waves


@harmonics.defjvp
def _slope(
    orders: tuple[int, ...], primals: tuple[JaxArray], tangents: tuple[JaxArray]
) -> tuple[JaxArray, JaxArray]:
    waves = harmonics(orders, *primals)
    return waves, rates(orders, waves) * tangents[0]


def rates(orders: tuple[int, ...], waves: JaxArray) -> JaxArray:
    """Return the slopes of harmonics over the angle, of their values (2 order, batch)."""
    cosine, sine = jnp.split(waves, 2)
    factors = np.asarray(orders, dtype=np.float64)[:, None]
    return jnp.concatenate([-factors * sine, factors * cosine])


def _plain(angle: JaxArray, orders: tuple[int, ...]) -> JaxArray:
    turned = np.asarray(orders, dtype=np.float64)[:, None] * angle
    return jnp.concatenate([jnp.cos(turned), jnp.sin(turned)])


def _in_c(angle: JaxArray, orders: tuple[int, ...]) -> JaxArray:
    shape = jax.ShapeDtypeStruct((2 * len(orders), *angle.shape), angle.dtype)
    call = jax.ffi.ffi_call("penode_harmonics", shape, vmap_method="sequential")
    waves: JaxArray = call(angle, np.asarray(orders, dtype=np.float64))
    return waves
