"""The inverter: from the voltage a controller asks for to the one the machine's terminals get.

A *hold* says in which frame the voltage stands still between two samples; dead time and device
drops act on the phases, by the sign of their currents, at every moment within the interval.

The records of the bench that enter compiled code are equinox modules, not dataclasses registered
with JAX: two registered dataclasses of like fields compare equal as structures (JAX 0.10), and
`jax.jit` then runs the program of one hold with the values of the other.
"""

from typing import ClassVar, NamedTuple, Protocol

import equinox as eqx
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.bench.phases import phases, rotated, stationary
from penode.bench.voltage_limits import Circle, VoltageLimit


class Pulses(NamedTuple):
    """An interval's voltages: durations (pulse,), s; vectors (pulse, 2), V, in the hold's frame."""

    durations: JaxArray
    vectors: JaxArray


class Switching(NamedTuple):
    """What one interval's voltage is made from.

    Attributes
    ----------
    dc_voltage : array, shape ()
        Voltage of the dc link in V.
    period : array, shape ()
        Length of the interval, which is the switching period, in s.
    """

    dc_voltage: JaxArray | float
    period: JaxArray | float


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
        """Return dU, the voltage that a phase with much current loses, in V.

        Parameters
        ----------
        switching : Switching
            The dc voltage in V and the switching period in s.

        Returns
        -------
        array, shape ()
            In V.
        """
        return switching.dc_voltage * self.duration / switching.period

    def sign(self, current: JaxArray) -> JaxArray:
        """Return the smooth sign of each phase current.

        Parameters
        ----------
        current : array, shape (3,)
            Phase currents in A, positive into the machine.

        Returns
        -------
        array, shape (3,)
            ``tanh(i/i_0)``.
        """
        return jnp.tanh(current / self.current_scale)


class DeviceDrop(eqx.Module):
    """Voltage that stays on the conducting semiconductors: ``u_0 tanh(i/i_0) + r i`` a phase.

    Attributes
    ----------
    threshold : float
        u_0 in V, the mean of switch and diode.
    on_resistance : float
        r in ohm; no recording separates it from the winding's resistance.
    current_scale : float
        i_0 in A.
    phase_factors : tuple of three floats
        u_0 of the phases a, b, c over the threshold.
    soft : bool
        Whether the knee is ``2/pi arctan(i/i_0)``, which large currents still round.
    """

    threshold: float
    on_resistance: float = 0.0
    current_scale: float = 2.0
    phase_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    soft: bool = eqx.field(static=True, default=False)

    def drop(self, current: JaxArray) -> JaxArray:
        """Return the voltage lost in each phase.

        Parameters
        ----------
        current : array, shape (3,)
            Phase currents in A, positive into the machine.

        Returns
        -------
        array, shape (3,)
            In V.
        """
        scaled = current / self.current_scale
        knee = 2 / jnp.pi * jnp.arctan(scaled) if self.soft else jnp.tanh(scaled)
        threshold = self.threshold * jnp.stack(self.phase_factors)
        return threshold * knee + self.on_resistance * current


class Hold(Protocol):
    """How a voltage stands between two samples; its own frame is the one it stands still in.

    ``frame`` is its name, ``dq`` or ``stationary``, as a recording declares it.
    """

    frame: ClassVar[str]

    def command_angle(self, theta_el: JaxArray, turn: JaxArray) -> JaxArray:
        """Return the angle (rad) at which the controller's dq voltage is sent to the phases.

        ``theta_el`` is the measured angle in rad, ``turn`` the measured omega_el T in rad.
        """

    def frame_angle(self, theta_el: JaxArray) -> JaxArray:
        """Return the angle (rad) of the hold's own frame at a true rotor angle ``theta_el``."""

    def mean_lag(self, delay: int) -> float:
        """Return by how many samples' turn the mean voltage lags the one asked for."""

    def pulses(
        self, vector: JaxArray, current: JaxArray, dead_time: DeadTime | None, switching: Switching
    ) -> Pulses:
        """Return the pulses for a voltage (2,) in V; ``current`` (3,) in A is the sampled one."""

    def dead_time_loss(
        self, dead_time: DeadTime, current: JaxArray, switching: Switching
    ) -> JaxArray:
        """Return the phase voltages (3,) in V that the pulses do not lose by themselves."""


class RotorHold(eqx.Module):
    """Ideal hold: the voltage turns with the rotor, constant in dq from sample to sample."""

    frame: ClassVar[str] = "dq"

    def command_angle(self, theta_el: JaxArray, turn: JaxArray) -> JaxArray:
        """Return the measured angle in rad; see `Hold`."""
        return theta_el

    def frame_angle(self, theta_el: JaxArray) -> JaxArray:
        """Return the rotor's angle in rad; see `Hold`."""
        return theta_el

    def mean_lag(self, delay: int) -> float:
        """Return 0 samples; see `Hold`."""
        return 0.0

    def pulses(
        self, vector: JaxArray, current: JaxArray, dead_time: DeadTime | None, switching: Switching
    ) -> Pulses:
        """Return one pulse of the whole interval; see `Hold`."""
        return Pulses(jnp.asarray(switching.period)[None], vector[None])

    def dead_time_loss(
        self, dead_time: DeadTime, current: JaxArray, switching: Switching
    ) -> JaxArray:
        """Return ``dU tanh(i/i_0)`` in V; see `Hold`."""
        return dead_time.voltage(switching) * dead_time.sign(current)


class StationaryHold(eqx.Module):
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
        """Return one pulse of the whole interval; see `Hold`."""
        return Pulses(jnp.asarray(switching.period)[None], vector[None])

    def dead_time_loss(
        self, dead_time: DeadTime, current: JaxArray, switching: Switching
    ) -> JaxArray:
        """Return ``dU tanh(i/i_0)`` in V; see `Hold`."""
        return dead_time.voltage(switching) * dead_time.sign(current)


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
        """Return the voltage at the machine's terminals at one moment.

        Parameters
        ----------
        vector : array, shape (2,)
            The pulse's voltage in V, in the hold's frame.
        current : array, shape (2,)
            Terminal i_d and i_q in A.
        theta_el : array, shape ()
            True electrical angle in rad.
        switching : Switching
            The dc voltage in V and the switching period in s.

        Returns
        -------
        array, shape (2,)
            u_d and u_q in V.
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
