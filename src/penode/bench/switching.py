"""Pulse-width modulation to the switching instant, for when the averaged inverter is not enough."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.bench.inverter import DeadTime, Pulses, Switching
from penode.bench.phases import phases, stationary


class CarrierPwm(eqx.Module):
    """Centre-aligned carrier, sampled where it turns: one switching period to a sample.

    Each phase is high for the share ``1/2 + (u + u_0)/u_dc`` of the period, in its middle; u_0
    centres the three phases between the rails, which reaches ``u_dc/sqrt(3)`` at every angle. The
    currents are sampled at the ends of the period, where their switching ripple crosses zero. Dead
    time delays the rising edge of a phase that feeds current in, the falling edge of the others.
    Averaged over the period this is `StationaryHold` with `DeadTime`.

    Attributes
    ----------
    advance : float
        By how many samples' turn the controller sends the voltage ahead; see `StationaryHold`.
    """

    advance: float = 0.0
    frame: ClassVar[str] = "stationary"

    def command_angle(self, theta_el: JaxArray, turn: JaxArray) -> JaxArray:
        """Return the measured angle, advanced, in rad; see `Hold`."""
        return theta_el + self.advance * turn

    def frame_angle(self, theta_el: JaxArray) -> JaxArray:
        """Return 0 rad; see `Hold`."""
        return jnp.zeros_like(theta_el)

    def mean_lag(self, delay: int) -> float:
        """Return ``delay + 1/2 - advance`` samples; see `Hold`."""
        return delay + 0.5 - self.advance

    def pulses(
        self, vector: JaxArray, current: JaxArray, dead_time: DeadTime | None, switching: Switching
    ) -> Pulses:
        """Return the seven switching states of one period.

        Parameters
        ----------
        vector : array, shape (2,)
            Mean voltage wanted in the stationary frame in V.
        current : array, shape (3,)
            Phase currents at the start of the period in A, which decide on the dead time.
        dead_time : DeadTime or None
            Dead time of the legs.
        switching : Switching
            The dc voltage in V and the switching period in s.

        Returns
        -------
        Pulses
            Seven; equal edges make pulses of no length.
        """
        period = jnp.asarray(switching.period)
        rise, fall = self._edges(vector, switching)
        if dead_time is not None:
            into = (1.0 + dead_time.sign(current)) / 2.0
            rise = rise + dead_time.duration * into
            fall = fall + dead_time.duration * (1.0 - into)
        rise, fall = jnp.clip(rise, 0.0, period), jnp.clip(fall, 0.0, period)
        edges = jnp.sort(jnp.concatenate([jnp.zeros(1), rise, fall, period[None]]))
        middle = (edges[1:] + edges[:-1]) / 2.0
        high = (rise <= middle[:, None]) & (middle[:, None] < fall)
        legs = switching.dc_voltage * jnp.where(high, 1.0, 0.0)
        return Pulses(jnp.diff(edges), jax.vmap(stationary)(legs))

    def dead_time_loss(
        self, dead_time: DeadTime, current: JaxArray, switching: Switching
    ) -> JaxArray:
        """Return 0 V: the edges already lose it; see `Hold`."""
        return jnp.zeros(3)

    @staticmethod
    def _edges(vector: JaxArray, switching: Switching) -> tuple[JaxArray, JaxArray]:
        """Return when each phase rises and falls without dead time, two times (3,) in s."""
        wanted = phases(vector)
        centred = wanted - (wanted.max() + wanted.min()) / 2.0
        share = jnp.clip(0.5 + centred / switching.dc_voltage, 0.0, 1.0)
        rise = switching.period * (1.0 - share) / 2.0
        return rise, switching.period - rise
