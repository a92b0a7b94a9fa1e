"""Drives that gym-electric-motor simulates; the current control is the plain one below."""

from typing import Any

import numpy as np
from gym_electric_motor import physical_systems as parts
from gym_electric_motor.physical_systems.physical_systems import SynchronousMotorSystem

from validate.other_simulators.drive_log import TIME_STEP, DriveLog
from validate.other_simulators.machines import Machine
from validate.other_simulators.plan import Planned
from validate.other_simulators.references import Profile, Reference
from validate.other_simulators.sensors import Sensors

#: Inductances in H and the magnet's flux linkage in Vs: those of gym-electric-motor but the
#: servo's, which are invented.
IRON = {
    "IPM 50 kW": {"l_d": 0.37e-3, "l_q": 1.2e-3, "psi_p": 66e-3},
    "SPM servo 0.4 ohm": {"l_d": 2.0e-3, "l_q": 2.0e-3, "psi_p": 60e-3},
    "SynRM 0.57 ohm": {"l_d": 10.1e-3, "l_q": 4.1e-3},
}
_BANDWIDTH = 2 * np.pi * 200
_PHASES = np.exp(2j * np.pi / 3 * np.arange(3))


def flux_of(machine: Machine, current: np.ndarray) -> np.ndarray:
    """Return the flux linkage psi_d + j psi_q in Vs at currents in A."""
    iron = IRON[machine.name]
    return iron["l_d"] * current.real + iron.get("psi_p", 0.0) + 1j * iron["l_q"] * current.imag


def flux_map(machine: Machine) -> tuple[np.ndarray, np.ndarray]:
    """Return samples of the map, currents in A and flux linkages in Vs, complex."""
    grid = machine.current * np.linspace(-1, 1, 33)
    current = (grid[:, None] + 1j * grid).ravel()
    return current, flux_of(machine, current)


class CurrentControl:
    """A PI controller of the current through the flux linkage, with the rotation fed forward.

    Parameters
    ----------
    machine : Machine
    limit : float
        Largest voltage, in V.
    """

    def __init__(self, machine: Machine, limit: float):
        self.machine, self.limit, self.integral = machine, limit, 0j

    def command(self, wanted: complex, measured: complex, speed: float) -> tuple[complex, complex]:
        """Return the voltage wanted and what the link can supply of it, in V."""
        error = complex(flux_of(self.machine, np.array([wanted, measured])) @ [1, -1])
        rotation = 1j * speed * complex(flux_of(self.machine, np.array(measured)))
        voltage = complex(_BANDWIDTH * error + self.integral + rotation)
        limited = voltage * min(1.0, self.limit / max(abs(voltage), 1e-9))
        back = (limited - voltage) / _BANDWIDTH
        self.integral += _BANDWIDTH**2 / 4 * TIME_STEP * (error + back)
        return voltage, limited


def _system(planned: Planned, profile: Profile, link_voltage: float) -> SynchronousMotorSystem:
    machine = planned.machine
    values = {"p": machine.pole_pairs, "r_s": machine.resistance, **IRON[machine.name]}
    reluctance = "psi_p" not in values
    motor = (
        parts.SynchronousReluctanceMotor if reluctance else parts.PermanentMagnetSynchronousMotor
    )
    return SynchronousMotorSystem(
        control_space="dq",
        supply=parts.IdealVoltageSupply(u_nominal=link_voltage),
        converter=parts.ContB6BridgeConverter(
            tau=TIME_STEP, interlocking_time=planned.kind.drive.get("dead_time", 0.0)
        ),
        motor=motor(motor_parameter={**values, "j_rotor": 0.01}),
        load=parts.ExternalSpeedLoad(speed_profile=profile, tau=TIME_STEP),
        ode_solver=parts.ScipyOdeSolver("dopri5", rtol=1e-8, atol=1e-8),
        tau=TIME_STEP,
    )


def simulate(
    planned: Planned, part: int, reference: Reference, profile: Profile, link_voltage: float
) -> tuple[DriveLog, np.ndarray]:
    """Simulate a drive whose voltage acts one sample after it was computed.

    Returns
    -------
    DriveLog
        With ``"applied"`` or ``"command"`` voltages, as the kind says.
    ndarray, shape (time,)
        Resistance in ohm at each sample.
    """
    machine, kind = planned.machine, planned.kind
    system, sensors = _system(planned, profile, link_voltage), Sensors(planned, part)
    control = CurrentControl(machine, link_voltage / 2)
    names = {name: k for k, name in enumerate(system.state_names)}
    state, acting, rows = system.reset() * system.limits, 0j, []
    for k in range(round(kind.duration / TIME_STEP) + 1):
        angle, shaft = state[names["epsilon"]], state[names["omega"]]
        current = _measured(complex(state[names["i_sd"]], state[names["i_sq"]]), angle, sensors)
        speed = machine.pole_pairs * shaft
        wanted, limited = control.command(reference(k * TIME_STEP), current, speed)
        resistance = planned.resistance(k * TIME_STEP)
        _set_resistance(system.electrical_motor, resistance)
        written = wanted if kind.voltage == "command" else acting
        rows.append((current, written, speed, angle, resistance))
        action = np.array([acting.real, acting.imag]) / (link_voltage / 2)
        state = system.simulate(action) * system.limits
        acting = limited
    log = np.array(rows).T
    return DriveLog(log[0], log[1], log[2].real, log[3].real, link_voltage), log[4].real


def _measured(current: complex, angle: float, sensors: Sensors) -> complex:
    """Return the current of the rotor's frame by way of the three sensors."""
    turn = np.exp(1j * angle)
    phases = np.real(current * turn * _PHASES.conj())
    return complex(2 / 3 * np.sum(sensors(phases) * _PHASES) / turn)


def _set_resistance(motor: Any, resistance: float) -> None:
    """Set the resistance; the motor has no other way to it than its own table."""
    if motor.motor_parameter["r_s"] != resistance:
        motor.motor_parameter["r_s"] = resistance
        motor._update_model()
