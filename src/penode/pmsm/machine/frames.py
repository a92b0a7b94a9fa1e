"""The rotor frame: amplitude-invariant Clarke-Park transform and its inverse.

With theta the electrical angle of the d axis seen from phase a (METHOD section 2)::

    x_d =  2/3 (x_a cos(theta) + x_b cos(theta - 2 pi/3) + x_c cos(theta + 2 pi/3))
    x_q = -2/3 (x_a sin(theta) + x_b sin(theta - 2 pi/3) + x_c sin(theta + 2 pi/3))
    x_a = x_d cos(theta) - x_q sin(theta), and b, c at theta -+ 2 pi/3

A balanced set of peak value X becomes a dq vector of length X, and the power of the three phases
is 3/2 (u_d i_d + u_q i_q).
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray

_PHASES = np.array([0.0, 2.0, -2.0]) * np.pi / 3.0


def _axes(theta_el: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cos and -sin of the angle from each phase to the d axis, shape (..., phase)."""
    angle = np.asarray(theta_el, dtype=np.float64)[..., None] - _PHASES
    return np.cos(angle), -np.sin(angle)


def dq_from_abc(abc: FloatArray, theta_el: FloatArray) -> FloatArray:
    """Transform phase quantities to the rotor frame.

    Parameters
    ----------
    abc : ndarray, shape (..., 3)
        Phase values a, b, c in any unit. Their zero sequence is dropped.
    theta_el : ndarray, shape (...)
        Electrical angle of the d axis in rad.

    Returns
    -------
    ndarray, shape (..., 2)
        d and q components in the unit given, amplitude invariant.
    """
    d_axis, q_axis = _axes(theta_el)
    values = np.asarray(abc, dtype=np.float64)
    return 2.0 / 3.0 * np.stack([(values * d_axis).sum(-1), (values * q_axis).sum(-1)], axis=-1)


def abc_from_dq(dq: FloatArray, theta_el: FloatArray) -> FloatArray:
    """Transform rotor-frame quantities to the phases.

    Parameters
    ----------
    dq : ndarray, shape (..., 2)
        d and q components in any unit, amplitude invariant.
    theta_el : ndarray, shape (...)
        Electrical angle of the d axis in rad.

    Returns
    -------
    ndarray, shape (..., 3)
        Phase values a, b, c in the unit given, without zero sequence.
    """
    d_axis, q_axis = _axes(theta_el)
    values = np.asarray(dq, dtype=np.float64)
    return values[..., :1] * d_axis + values[..., 1:] * q_axis


def quarter_turned(vector: Any) -> Any:
    """Return J x = (-x_q, x_d), x (2, ...) turned by 90 degrees, of NumPy or JAX."""
    signs = np.array([-1.0, 1.0]).reshape(2, *(1,) * (np.ndim(vector) - 1))
    return signs * vector[::-1]


def solved(matrix: Any, vector: Any) -> Any:
    """Return the solution x (2, ...) of M x = v, M (2, 2, ...), of NumPy or JAX.

    It is not finite where the matrix is singular.
    """
    if isinstance(vector, jax.Array) or isinstance(matrix, jax.Array):
        return _solved(matrix, vector)
    return _product(_inverse(matrix, np), vector)


@jax.custom_jvp
def _solved(matrix: JaxArray, vector: JaxArray) -> JaxArray:
    return _product(_inverse(matrix, jnp), vector)


@_solved.defjvp
def _solved_jvp(
    primals: tuple[JaxArray, JaxArray], tangents: tuple[JaxArray, JaxArray]
) -> tuple[JaxArray, JaxArray]:
    """Derive M x = v as a whole, dx = M^-1 (dv - dM x)."""
    inverse = _inverse(primals[0], jnp)
    x = _product(inverse, primals[1])
    return x, _product(inverse, tangents[1] - _product(tangents[0], x))


def _product(matrix: Any, vector: Any) -> Any:
    """Return the product (2, ...) of a matrix (2, 2, ...) and a vector (2, ...)."""
    return (matrix * vector).sum(axis=1)


def _inverse(matrix: Any, library: Any) -> Any:
    (a, b), (c, d) = matrix
    adjugate = library.stack([library.stack([d, -b]), library.stack([-c, a])])
    return adjugate / (a * d - b * c)
