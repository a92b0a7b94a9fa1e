"""Phases, stationary frame and rotor frame inside compiled code: amplitude invariant, as in frames.

The stationary frame is the rotor frame at angle zero, so one rotation and one pair of transforms
between it and the phases are all there is.
"""

import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray

_SHARE = np.array([1.0, -0.5, -0.5])
_CROSS = np.array([0.0, np.sqrt(3.0) / 2, -np.sqrt(3.0) / 2])


def rotated(vector: JaxArray, angle: JaxArray) -> JaxArray:
    """Turn a vector (2,) forward by rad: theta_el leads from rotor to stationary frame."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def quarter_turned(vector: JaxArray) -> JaxArray:
    """Return J times a vector (2,), ``(-x[1], x[0])``: turned forward by 90 degrees."""
    return jnp.stack([-vector[1], vector[0]])


def phases(stationary: JaxArray) -> JaxArray:
    """Return the phases a, b, c (3,), without zero sequence, of alpha and beta (2,)."""
    by_phase: JaxArray = _SHARE * stationary[0] + _CROSS * stationary[1]
    return by_phase


def stationary(abc: JaxArray) -> JaxArray:
    """Return alpha and beta (2,) of the phases a, b, c (3,); their zero sequence is dropped."""
    vector: JaxArray = 2.0 / 3.0 * jnp.stack([(_SHARE * abc).sum(), (_CROSS * abc).sum()])
    return vector
