"""Integrals over a sample in which the rotor turns: what a rotating frame makes of held values."""

import numpy as np

from penode.arrays import ComplexArray


def held(z: ComplexArray) -> ComplexArray:
    """Return int_0^1 exp(z (1 - s)) ds = (exp(z) - 1) / z, 1 at zero.

    z is -j omega T for a frame that turns by omega T.
    """
    safe = np.where(z == 0, 1.0, z)
    return np.asarray(np.where(z == 0, 1.0, np.expm1(safe) / safe))


def rising(z: ComplexArray) -> ComplexArray:
    """Return int_0^1 exp(z (1 - s)) s ds = (exp(z) - 1 - z) / z^2, 1/2 at zero.

    Below 1e-3 the series stands in, where the difference would cancel.
    """
    small = np.abs(z) < 1e-3
    safe = np.where(small, 1.0, z)
    series: ComplexArray = 1 / 2 + z / 6 + z**2 / 24
    return np.asarray(np.where(small, series, (np.expm1(safe) - safe) / safe**2))
