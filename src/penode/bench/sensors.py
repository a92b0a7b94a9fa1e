"""The sensors: what the controller and the file see of currents, angle and speed."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.bench.phases import phases, quarter_turned, rotated, stationary


class Quantisation(eqx.Module):
    """An analogue-to-digital converter, rounding to the nearest step and clipping at its range."""

    # Largest current it can measure, of either sign, A.
    full_scale: float
    bits: int = eqx.field(static=True, default=12)

    @property
    def step(self) -> float:
        """Least significant bit in A, ``2 full_scale / 2^bits``."""
        return 2.0 * self.full_scale / 2.0**self.bits

    def rounded(self, current: JaxArray) -> JaxArray:
        """Return the nearest currents, A, that the converter knows."""
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
        """Return the slope of the filter's output (2,), A/s, as the rotor frame sees it.

        ``dy/dt = 2 pi f_c (i - y) - omega J y``: a filter of the phases, rotated. i is the true
        terminal current (2,), A, omega the true electrical speed, rad/s.
        """
        assert self.cutoff_hz is not None
        rate = 2.0 * np.pi * self.cutoff_hz
        return rate * (current - filtered) - omega_el * quarter_turned(filtered)

    def read(self, current: JaxArray, theta_el: JaxArray, draw: JaxArray) -> JaxArray:
        """Return the phase currents (3,), A, as the controller gets them.

        The current (2,), A, is behind the filter, in the true rotor frame; draws (3,) are normal.
        """
        true = phases(rotated(current, theta_el))
        analogue = jnp.stack(self.gain) * true + jnp.stack(self.offset) + self.noise * draw
        return analogue if self.quantisation is None else self.quantisation.rounded(analogue)


class Resolver(eqx.Module):
    """An angle sensor whose error turns with the rotor and grows with the current.

    ``theta_measured = theta + offset + (1 + growth |i|) sum_n a_n sin(n theta + phi_n)``. The
    Park transform turns by that error, so a constant current i shows ``i exp(-j error)``: lines at
    the orders n (of size a_n |i|), and, second order in a_n, at sums and differences of them.

    Attributes
    ----------
    offset : float
        Static error in rad electrical.
    orders : tuple of (float, float, float)
        ``(n, a_n, phi_n)``: order of the electrical angle, amplitude at no current in rad
        electrical, phase in rad.
    growth : float
        Relative growth of the amplitudes with the length of the current vector, in 1/A.
    """

    offset: float = 0.0
    orders: tuple[tuple[float, float, float], ...] = ()
    growth: float = 0.0

    def read(self, theta_el: JaxArray, current: JaxArray) -> JaxArray:
        """Return the measured angle (rad) at the true one and the terminal current (2,), A."""
        error = sum((a * jnp.sin(n * theta_el + phi) for n, a, phi in self.orders), jnp.zeros(()))
        growth = 1.0 + self.growth * jnp.hypot(current[0], current[1])
        return theta_el + self.offset + growth * error


class SpeedSensor(eqx.Module):
    """A speed signal with white noise and waves that the shaft does not have.

    ``omega_measured = omega (1 + noise N(0, 1) + sum_m a_m cos(m theta_mech + phi_m))``
    """

    # Standard deviation of the white noise over the speed.
    noise: float = 0.0
    # (m, a_m, phi_m): order of the mechanical angle, amplitude over the speed, phase in rad.
    orders: tuple[tuple[float, float, float], ...] = ()

    def read(self, omega_el: JaxArray, theta_mech: JaxArray, draw: JaxArray) -> JaxArray:
        """Return the measured electrical speed, rad/s, at a true one and a mechanical angle."""
        waves = sum((a * jnp.cos(m * theta_mech + phi) for m, a, phi in self.orders), jnp.zeros(()))
        return omega_el * (1.0 + self.noise * draw + waves)


class Draws(NamedTuple):
    """Standard normal numbers of a sample: dq (..., 2), phase sensors (..., 3), speed (...)."""

    dq: JaxArray
    phase: JaxArray
    speed: JaxArray


class Terminals(NamedTuple):
    """The truth at a sampling instant: currents (2,), A, angle, rad, and speed, rad/s."""

    current: JaxArray
    # The current behind the anti-alias filter.
    filtered: JaxArray | None
    # Within one mechanical turn.
    theta_el: JaxArray
    omega_el: JaxArray


class Reading(NamedTuple):
    """What the controller and the file get at a sampling instant, in A, rad and rad/s."""

    # i_d and i_q (2,), transformed with the measured angle.
    current: JaxArray
    theta_el: JaxArray
    omega_el: JaxArray


class Sensors(eqx.Module):
    """All sensors of a drive; where there is none, the truth is read."""

    current: CurrentSensors | None
    resolver: Resolver | None
    speed: SpeedSensor | None
    # Standard deviation in A of white noise on each dq current, beside the sensors'.
    dq_noise: float
    pole_pairs: float

    def read(self, terminals: Terminals, draws: Draws) -> Reading:
        """Return what the controller and the file get of the truth."""
        theta_el, omega_el = terminals.theta_el, terminals.omega_el
        if self.resolver is not None:
            theta_el = self.resolver.read(theta_el, terminals.current)
        if self.speed is not None:
            omega_el = self.speed.read(omega_el, terminals.theta_el / self.pole_pairs, draws.speed)
        current = self._current(terminals, theta_el, draws.phase) + self.dq_noise * draws.dq
        return Reading(current, theta_el, omega_el)

    def _current(self, terminals: Terminals, measured: JaxArray, draw: JaxArray) -> JaxArray:
        if self.current is None:
            return rotated(terminals.current, terminals.theta_el - measured)
        behind = terminals.current if terminals.filtered is None else terminals.filtered
        by_phase = self.current.read(behind, terminals.theta_el, draw)
        return rotated(stationary(by_phase), -measured)
