"""Sensors of the phase currents: filter, gain, offset, noise and converter."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.bench.phases import phases, quarter_turned, rotated


class Quantisation(eqx.Module):
    """An analogue-to-digital converter, rounding to the nearest step and clipping at its range.

    Attributes
    ----------
    full_scale : float
        Largest current it can measure, of either sign, in A.
    bits : int
        Resolution; one step is ``2 full_scale / 2^bits``.
    """

    full_scale: float
    bits: int = eqx.field(static=True, default=12)

    @property
    def step(self) -> float:
        """Least significant bit in A."""
        return 2.0 * self.full_scale / 2.0**self.bits

    def rounded(self, current: JaxArray) -> JaxArray:
        """Return the nearest current the converter knows.

        Parameters
        ----------
        current : array, any shape
            In A.

        Returns
        -------
        array of that shape
            In A.
        """
        clipped = jnp.clip(current, -self.full_scale, self.full_scale - self.step)
        return self.step * jnp.round(clipped / self.step)


class CurrentSensors(eqx.Module):
    """Three phase-current sensors: filter, gain and offset, noise, converter, in this order.

    In the rotor frame a constant offset has order 1, and unequal gains have order 2.

    Attributes
    ----------
    gain : tuple of three floats
        Gain of the sensors a, b, c; 1 is right.
    offset : tuple of three floats
        Offset of a, b, c in A. A part common to all three does not reach dq.
    noise : float
        Standard deviation of the white noise on each phase in A.
    cutoff_hz : float or None
        Frequency in Hz at which the first-order anti-alias filter passes 1/sqrt(2); None: none.
    quantisation : Quantisation or None
        The converter; None: continuous values.
    """

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: float = 0.0
    cutoff_hz: float | None = None
    quantisation: Quantisation | None = None

    def filter_rate(self, filtered: JaxArray, current: JaxArray, omega_el: JaxArray) -> JaxArray:
        """Return the slope of the filter's output as the rotor frame sees it.

        ``dy/dt = 2 pi f_c (i - y) - omega J y``: a filter of the phases, rotated.

        Parameters
        ----------
        filtered, current : array, shape (2,)
            The filter's output y and the true terminal current in the rotor frame, in A.
        omega_el : array, shape ()
            True electrical speed in rad/s.

        Returns
        -------
        array, shape (2,)
            dy/dt in A/s.
        """
        assert self.cutoff_hz is not None
        rate = 2.0 * np.pi * self.cutoff_hz
        return rate * (current - filtered) - omega_el * quarter_turned(filtered)

    def read(self, current: JaxArray, theta_el: JaxArray, draw: JaxArray) -> JaxArray:
        """Return the phase currents as the controller gets them.

        Parameters
        ----------
        current : array, shape (2,)
            i_d and i_q behind the filter, in the true rotor frame, in A.
        theta_el : array, shape ()
            True electrical angle in rad.
        draw : array, shape (3,)
            Standard normal numbers.

        Returns
        -------
        array, shape (3,)
            i_a, i_b, i_c in A.
        """
        true = phases(rotated(current, theta_el))
        analogue = jnp.stack(self.gain) * true + jnp.stack(self.offset) + self.noise * draw
        return analogue if self.quantisation is None else self.quantisation.rounded(analogue)
