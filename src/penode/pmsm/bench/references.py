"""Current references: what the drive is asked to follow."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from penode.arrays import FloatArray

#: Takes times in s, shape (time,), and returns i_d and i_q in A, shape (time, 2).
Reference: TypeAlias = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Lissajous:
    """Double-sine sweep over the disc of a maximum current.

    ``i_q = I sin(phi_q t)``, ``i_d = sqrt(I^2 - i_q^2) sin(phi_d t)``: Montecchio et al., Horizon
    Selection in Physics-Enhanced Neural ODEs, section 5. Nearly equal rates cover the disc densely.

    Attributes
    ----------
    amplitude : float
        Radius I of the disc in A (peak value of a phase).
    rate_d, rate_q : float
        Angular frequencies phi_d and phi_q in rad/s.
    """

    amplitude: float
    rate_d: float
    rate_q: float

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at the given times.

        Parameters
        ----------
        time : ndarray, shape (time,)
            Times in s.

        Returns
        -------
        ndarray, shape (time, 2)
            i_d and i_q in A.
        """
        i_q = self.amplitude * np.sin(self.rate_q * time)
        i_d = np.sqrt(self.amplitude**2 - i_q**2) * np.sin(self.rate_d * time)
        return np.stack([i_d, i_q], axis=1)
