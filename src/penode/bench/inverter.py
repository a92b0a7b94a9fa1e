"""The inverter: from the voltage a controller asks for to the one the machine's terminals get.

A *hold* says in which frame the voltage stands still between two samples; dead time and device
drops act on the phases, by the sign of their currents, at every moment within the interval.

The records of the bench that enter compiled code are equinox modules, not dataclasses registered
with JAX: two registered dataclasses of like fields compare equal as structures (JAX 0.10), and
`jax.jit` then runs the program of one hold with the values of the other.
"""

from typing import ClassVar, NamedTuple, Protocol, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.bench.phases import phases, rotated, stationary


class Pulses(NamedTuple):
    """An interval's voltages: durations (pulse,), s; vectors (pulse, 2), V, in the hold's frame."""

    durations: JaxArray
    vectors: JaxArray


class Switching(NamedTuple):
    """What an interval's voltage is made from: the dc link in V, the switching period in s."""

    dc_voltage: JaxArray | float
    period: JaxArray | float


class VoltageLimit(Protocol):
    """The set of voltages that a dc link permits."""

    def used(self, voltage: JaxArray, theta_el: JaxArray, dc_voltage: JaxArray | float) -> JaxArray:
        """Return the length of a dq voltage (2,) in V over the longest permitted in its direction.

        ``theta_el`` is the angle (rad) at which it is sent to the phases, ``dc_voltage`` in V.
        """


class Circle(eqx.Module):
    """The voltages reachable at every angle: length at most ``u_dc / sqrt(3)``."""

    def used(self, voltage: JaxArray, theta_el: JaxArray, dc_voltage: JaxArray | float) -> JaxArray:
        """Return the length over ``u_dc / sqrt(3)``; see `VoltageLimit`."""
        share: JaxArray = jnp.hypot(voltage[0], voltage[1]) / (dc_voltage / np.sqrt(3.0))
        return share


class Hexagon(eqx.Module):
    """All voltages an inverter can make: no line-to-line voltage above u_dc."""

    def used(self, voltage: JaxArray, theta_el: JaxArray, dc_voltage: JaxArray | float) -> JaxArray:
        """Return the largest line-to-line voltage over u_dc; see `VoltageLimit`."""
        by_phase = phases(rotated(voltage, theta_el))
        return (by_phase.max() - by_phase.min()) / dc_voltage


class DeadTime(eqx.Module):
    """Voltage lost because both switches of a leg are off for a while.

    Each phase loses ``dU tanh(i/i_0)``, ``dU = u_dc t_dead / T``: a square wave in the sign of the
    phase current, of fundamental 4/pi dU, which is constant in the rotor frame beside the orders 6,
    12, ... The crossing is smooth because a small current cannot recharge the switches'
    capacitances. Jeong and Park, IEEE Trans. Ind. Electron. 38 (1991) 108, doi:10.1109/41.88903.

    Attributes
    ----------
    duration : float
        t_dead in s.
    current_scale : float
        i_0 in A, the current at which 76 % of dU are lost.
    """

    duration: float
    current_scale: float = 2.0

    def voltage(self, switching: Switching) -> JaxArray | float:
        """Return dU, the voltage that a phase with much current loses, in V."""
        return switching.dc_voltage * self.duration / switching.period

    def sign(self, current: JaxArray) -> JaxArray:
        """Return ``tanh(i/i_0)`` of the phase currents (3,), A, positive into the machine."""
        return jnp.tanh(current / self.current_scale)


class DeviceDrop(eqx.Module):
    """Voltage that stays on the conducting semiconductors: ``u_0 tanh(i/i_0) + r i`` a phase."""

    # u_0, V: the mean of switch and diode.
    threshold: float
    # r, ohm; no recording separates it from the winding's resistance.
    on_resistance: float = 0.0
    # i_0, A.
    current_scale: float = 2.0
    # u_0 of the phases a, b, c over the threshold.
    phase_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    # Whether the knee is ``2/pi arctan(i/i_0)``, which large currents still round.
    soft: bool = eqx.field(static=True, default=False)

    def drop(self, current: JaxArray) -> JaxArray:
        """Return the voltages (3,), V, lost at phase currents (3,), A, into the machine."""
        scaled = current / self.current_scale
        knee = 2 / jnp.pi * jnp.arctan(scaled) if self.soft else jnp.tanh(scaled)
        threshold = self.threshold * jnp.stack(self.phase_factors)
        return threshold * knee + self.on_resistance * current


class RotorHold(eqx.Module):
    """Ideal hold: the voltage turns with the rotor, constant in dq from sample to sample.

    The other holds differ from it; ``frame`` is the one in which a recording declares its hold.
    """

    frame: ClassVar[str] = "dq"

    def command_angle(self, theta_el: JaxArray, turn: JaxArray) -> JaxArray:
        """Return the angle (rad) at which the controller's dq voltage is sent to the phases.

        ``theta_el`` is the measured angle in rad, ``turn`` the measured omega_el T in rad.
        """
        return theta_el

    def frame_angle(self, theta_el: JaxArray) -> JaxArray:
        """Return the angle (rad) of the hold's own frame at a true rotor angle (rad)."""
        return theta_el

    def mean_lag(self, delay: int) -> float:
        """Return by how many samples' turn the mean voltage lags the one asked for."""
        return 0.0

    def pulses(
        self, vector: JaxArray, current: JaxArray, dead_time: DeadTime | None, switching: Switching
    ) -> Pulses:
        """Return the pulses for a voltage (2,), V; sampled phase currents (3,), A, as they are."""
        return Pulses(jnp.asarray(switching.period)[None], vector[None])

    def dead_time_loss(
        self, dead_time: DeadTime, current: JaxArray, switching: Switching
    ) -> JaxArray:
        """Return the phase voltages (3,), V, that the pulses do not lose by themselves."""
        return dead_time.voltage(switching) * dead_time.sign(current)


class StationaryHold(RotorHold):
    """Real hold: the voltage stands still in the stationary frame while the rotor turns on.

    In dq it turns from 0 to -omega T within the interval; its mean is the voltage sent, shortened
    by ``sin(omega T/2)/(omega T/2)`` and turned by ``-omega T/2``.

    Attributes
    ----------
    advance : float
        By how many samples' turn the controller sends the voltage ahead; 0.5 makes up for the hold,
        1.5 for the hold and one sample of computation.
    """

    advance: float = 0.0
    frame: ClassVar[str] = "stationary"

    def command_angle(self, theta_el: JaxArray, turn: JaxArray) -> JaxArray:
        """Return the measured angle, advanced; see `RotorHold`."""
        return theta_el + self.advance * turn

    def frame_angle(self, theta_el: JaxArray) -> JaxArray:
        """Return 0 rad; see `RotorHold`."""
        return jnp.zeros_like(theta_el)

    def mean_lag(self, delay: int) -> float:
        """Return ``delay + 1/2 - advance`` samples; see `RotorHold`."""
        return delay + 0.5 - self.advance


class CarrierPwm(StationaryHold):
    """Centre-aligned carrier, sampled where it turns: one switching period to a sample.

    Each phase is high for the share ``1/2 + (u + u_0)/u_dc`` of the period, in its middle; u_0
    centres the three phases between the rails, which reaches ``u_dc/sqrt(3)`` at every angle. The
    currents are sampled at the ends of the period, where their switching ripple crosses zero. Dead
    time delays the rising edge of a phase that feeds current in, the falling edge of the others.
    Averaged over the period this is `StationaryHold` with `DeadTime`.
    """

    def pulses(
        self, vector: JaxArray, current: JaxArray, dead_time: DeadTime | None, switching: Switching
    ) -> Pulses:
        """Return the seven switching states of a period; equal edges make pulses of no length."""
        period = jnp.asarray(switching.period)
        wanted = phases(vector)
        centred = wanted - (wanted.max() + wanted.min()) / 2.0
        share = jnp.clip(0.5 + centred / switching.dc_voltage, 0.0, 1.0)
        rise = switching.period * (1.0 - share) / 2.0
        fall = switching.period - rise
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
        """Return 0 V: the edges already lose it; see `RotorHold`."""
        return jnp.zeros(3)


#: Any hold.
Hold: TypeAlias = RotorHold


class Inverter(eqx.Module):
    """What stands between the controller's voltage and the terminals; the default is ideal.

    Attributes
    ----------
    hold : Hold
        `RotorHold` (ideal), `StationaryHold` or `CarrierPwm`.
    limit : VoltageLimit
        `Circle` or `Hexagon`, what the controller keeps its voltage in.
    dead_time : DeadTime or None
        Dead time of the legs.
    devices : DeviceDrop or None
        Drops of the semiconductors.
    delay : int
        Samples of computation before a voltage acts: 0, or 1 in most drives. Together with a
        `StationaryHold` 1 makes one and a half samples.
    """

    hold: Hold = RotorHold()
    limit: VoltageLimit = Circle()
    dead_time: DeadTime | None = None
    devices: DeviceDrop | None = None
    delay: int = eqx.field(static=True, default=0)

    def terminal_voltage(
        self, vector: JaxArray, current: JaxArray, theta_el: JaxArray, switching: Switching
    ) -> JaxArray:
        """Return u_d and u_q (2,), V, at the terminals at one moment of a pulse.

        Its voltage `vector` (2,), V, is in the hold's frame; currents (2,), A; true angle in rad.
        """
        voltage = rotated(vector, self.hold.frame_angle(theta_el) - theta_el)
        if self.dead_time is None and self.devices is None:
            return voltage
        by_phase = phases(rotated(current, theta_el))
        lost = jnp.zeros(3)
        if self.dead_time is not None:
            lost = lost + self.hold.dead_time_loss(self.dead_time, by_phase, switching)
        if self.devices is not None:
            lost = lost + self.devices.drop(by_phase)
        return voltage - rotated(stationary(lost), -theta_el)
