"""The sensors: what the controller and the file see of currents, angle and speed."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.bench.current_sensors import CurrentSensors
from penode.bench.phases import rotated, stationary


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
        """Return the measured angle.

        Parameters
        ----------
        theta_el : array, shape ()
            True electrical angle in rad.
        current : array, shape (2,)
            True terminal i_d and i_q in A.

        Returns
        -------
        array, shape ()
            Measured electrical angle in rad.
        """
        error = sum((a * jnp.sin(n * theta_el + phi) for n, a, phi in self.orders), jnp.zeros(()))
        growth = 1.0 + self.growth * jnp.hypot(current[0], current[1])
        return theta_el + self.offset + growth * error


class SpeedSensor(eqx.Module):
    """A speed signal with white noise and waves that the shaft does not have.

    ``omega_measured = omega (1 + noise N(0, 1) + sum_m a_m cos(m theta_mech + phi_m))``

    Attributes
    ----------
    noise : float
        Standard deviation of the white noise over the speed.
    orders : tuple of (float, float, float)
        ``(m, a_m, phi_m)``: order of the mechanical angle, amplitude over the speed, phase in rad.
    """

    noise: float = 0.0
    orders: tuple[tuple[float, float, float], ...] = ()

    def read(self, omega_el: JaxArray, theta_mech: JaxArray, draw: JaxArray) -> JaxArray:
        """Return the measured speed.

        Parameters
        ----------
        omega_el : array, shape ()
            True electrical speed in rad/s.
        theta_mech : array, shape ()
            Mechanical angle in rad.
        draw : array, shape ()
            Standard normal number.

        Returns
        -------
        array, shape ()
            Measured electrical speed in rad/s.
        """
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
        theta_el = self._angle(terminals)
        current = self._current(terminals, theta_el, draws.phase) + self.dq_noise * draws.dq
        return Reading(current, theta_el, self._speed(terminals, draws.speed))

    def _angle(self, terminals: Terminals) -> JaxArray:
        if self.resolver is None:
            return terminals.theta_el
        return self.resolver.read(terminals.theta_el, terminals.current)

    def _current(self, terminals: Terminals, measured: JaxArray, draw: JaxArray) -> JaxArray:
        if self.current is None:
            return rotated(terminals.current, terminals.theta_el - measured)
        behind = terminals.current if terminals.filtered is None else terminals.filtered
        by_phase = self.current.read(behind, terminals.theta_el, draw)
        return rotated(stationary(by_phase), -measured)

    def _speed(self, terminals: Terminals, draw: JaxArray) -> JaxArray:
        if self.speed is None:
            return terminals.omega_el
        return self.speed.read(terminals.omega_el, terminals.theta_el / self.pole_pairs, draw)
