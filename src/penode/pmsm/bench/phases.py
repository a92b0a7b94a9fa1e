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
    """Turn a vector forward by an angle.

    Parameters
    ----------
    vector : array, shape (2,)
        Components in any unit. From the rotor to the stationary frame the angle is theta_el, back
        it is -theta_el.
    angle : array, shape ()
        Angle in rad.

    Returns
    -------
    array, shape (2,)
        In the unit given.
    """
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def quarter_turned(vector: JaxArray) -> JaxArray:
    """Return J times a vector: turned forward by 90 degrees.

    Parameters
    ----------
    vector : array, shape (2,)
        Components in any unit.

    Returns
    -------
    array, shape (2,)
        ``(-x[1], x[0])`` in the unit given.
    """
    return jnp.stack([-vector[1], vector[0]])


def phases(stationary: JaxArray) -> JaxArray:
    """Return the phase values of a vector in the stationary frame.

    Parameters
    ----------
    stationary : array, shape (2,)
        Components alpha and beta in any unit.

    Returns
    -------
    array, shape (3,)
        Phases a, b, c in the unit given, without zero sequence.
    """
    by_phase: JaxArray = _SHARE * stationary[0] + _CROSS * stationary[1]
    return by_phase


def stationary(abc: JaxArray) -> JaxArray:
    """Return the vector of three phase values in the stationary frame.

    Parameters
    ----------
    abc : array, shape (3,)
        Phases a, b, c in any unit. Their zero sequence is dropped.

    Returns
    -------
    array, shape (2,)
        Components alpha and beta in the unit given.
    """
    vector: JaxArray = 2.0 / 3.0 * jnp.stack([(_SHARE * abc).sum(), (_CROSS * abc).sum()])
    return vector
