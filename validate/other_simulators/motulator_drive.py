"""Drives that motulator simulates: machine, inverter and current control are its own."""

from functools import cache
from math import pi
from pathlib import Path
from typing import Any

import motulator.drive.control.sm as control
import numpy as np
from motulator.common.model import SolverCfg
from motulator.drive import model, utils

from validate.other_simulators.drive_log import TIME_STEP, DriveLog
from validate.other_simulators.machines import Machine
from validate.other_simulators.plan import Planned
from validate.other_simulators.references import Profile, Reference
from validate.other_simulators.sensors import Sensors

#: Machines without saturation, by the first word of their names.
_LINEAR = {
    "IPM": {"L_d": 0.036, "L_q": 0.051, "psi_f": 0.545},
    "SPM": {"L_d": 0.033, "L_q": 0.033, "psi_f": 0.545},
}


class Follower(control.CurrentVectorController):
    """motulator's current-vector control with references of current over time."""

    reference: Reference
    time = 0.0

    def compute_output(self, tau_M_ref: float, fbk: Any) -> Any:
        """Return its references, with the current wanted at this sample."""
        ref = super().compute_output(tau_M_ref, fbk)
        ref.i_s = self.reference(self.time)
        ref.u_s = self.current_ctrl.compute_output(ref.i_s, fbk.i_s)
        self.time += self.T_s
        return ref


@cache
def maps(name: str, thor: Path | None) -> tuple[Any, Any]:
    """Return psi -> i, which is simulated, and i -> psi, which the controller knows."""
    if name.startswith("THOR"):
        flux = utils.import_syre_data(thor)
        return flux.invert(), flux
    if name.startswith("SyRM"):
        saturation = utils.SaturationModelSyRM(
            a_d0=17.4, a_dd=373, S=5, a_q0=52.1, a_qq=658, T=1, a_dq=1120, U=1, V=0
        )
        low, high = complex(-0.7, -0.45), complex(0.7, 0.45)
    else:
        iron = {"a_d0": 3.96, "a_dd": 28.5, "S": 4, "a_q0": 5.89, "a_qq": 2.67, "T": 6}
        magnets = {"a_b": 81.75, "a_bp": 1, "k_q": 0.1, "psi_n": 0.804, "W": 2}
        cross = {"a_dq": 41.5, "U": 1, "V": 1}
        saturation = utils.SaturationModelPMSyRM(**iron, **cross, **magnets)
        low, high = complex(-0.1, -1.4), complex(1.0, 1.4)
    axes = (np.linspace(*ends, 256) for ends in ((low.real, high.real), (low.imag, high.imag)))
    return saturation, saturation.as_magnetic_model(*axes).invert()


def _parameters(machine: Machine, thor: Path | None, **changes: float) -> tuple[Any, Any]:
    """Return the parameters that are simulated and those of the controller."""
    shared = {"n_p": machine.pole_pairs, "R_s": machine.resistance}
    linear = _LINEAR.get(machine.name.split(" ")[0])
    if linear:
        simulated = model.SynchronousMachinePars(**shared, **linear, **changes)
        return simulated, control.SynchronousMachinePars(**shared, **linear)
    currents, flux = maps(machine.name, thor)
    simulated = model.SaturatedSynchronousMachinePars(**shared, i_s_dq_fcn=currents, **changes)
    return simulated, control.SaturatedSynchronousMachinePars(**shared, psi_s_dq_fcn=flux)


def flux_of(machine: Machine, current: np.ndarray, thor: Path | None) -> np.ndarray:
    """Return the flux linkage psi_d + j psi_q in Vs at currents, as the controller knows it."""
    return np.asarray(_parameters(machine, thor)[1].psi_s_dq(current))


def flux_map(machine: Machine, thor: Path | None) -> tuple[np.ndarray, np.ndarray]:
    """Return samples of the simulated map, currents in A and flux linkages in Vs, complex."""
    simulated, known = _parameters(machine, thor)
    grid = machine.current * np.linspace(-1, 1, 33)
    psi = np.asarray(known.psi_s_dq((grid[:, None] + 1j * grid).ravel()))
    current = np.asarray(simulated.i_s_dq(psi))
    inside = np.abs(current) < 1.2 * machine.current  # and a number: maps end somewhere
    return current[inside], psi[inside]


def simulate(
    planned: Planned,
    part: int,
    reference: Reference,
    profile: Profile,
    link_voltage: float,
    thor: Path | None = None,
) -> tuple[DriveLog, np.ndarray]:
    """Simulate a drive.

    Returns
    -------
    DriveLog
        With ``"applied"`` or ``"command"`` voltages, as the kind says.
    ndarray, shape (time,)
        Resistance in ohm at each sample.
    """
    machine, kind, does = planned.machine, planned.kind, planned.kind.drive
    loss = does.get("core_loss", 0.0) * machine.current / (machine.link_voltage / np.sqrt(3))
    simulated, known = _parameters(machine, thor, G_c=loss)
    shaft = model.ExternalRotorSpeed()
    shaft.set_external_rotor_speed(profile)
    drive = model.Drive(
        model.SynchronousMachine(simulated, i_s_sensor=Sensors(planned, part)),
        shaft,
        model.VoltageSourceConverter(u_dc=link_voltage, t_d=does.get("dead_time", 0.0)),
        pwm="pwm" in does,
    )
    cfg = control.CurrentVectorControllerCfg(
        i_s_max=2 * machine.current,
        sensorless=False,
        T_s=TIME_STEP,
        alpha_c=2 * pi * 200,
        psi_s_min=0.1,
    )
    follower, resistance = Follower(known, cfg), []

    def warming_reference(t: float) -> complex:
        simulated.R_s = planned.resistance(t)
        resistance.append(simulated.R_s)
        return reference(t)

    follower.reference = warming_reference
    system = control.VectorControlSystem(follower)
    system.set_torque_ref(0.0)
    accurate = SolverCfg(rtol=1e-7, atol=1e-9)
    run = model.Simulation(drive, system, show_progress=False, cfg=accurate)
    log = run.simulate(t_stop=kind.duration).ctrl
    voltage = log.ref.u_s if kind.voltage == "command" else log.fbk.u_s_zoh
    return (
        DriveLog(
            log.fbk.i_s, voltage, np.real(log.fbk.w_m), np.real(log.fbk.theta_m), link_voltage
        ),
        np.array(resistance),
    )
