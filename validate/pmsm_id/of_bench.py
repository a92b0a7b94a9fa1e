"""Logs of penode's own bench and of the plant in C, for PMSM-ID."""

import numpy as np

from penode.arrays import FloatArray
from penode.bench.coenergy_table import true_flux_map
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, DeviceDrop, Inverter, StationaryHold
from penode.bench.machines import MACHINES
from penode.bench.run import record
from penode.bench.sensors import CurrentSensors
from penode.bench.winding import IronLoss
from validate.other_simulators.drive_log import DriveLog
from validate.pmsm_id.simulated import Simulated
from validate.pmsm_id.tasks import GAIN, IRON, NOISE, OFFSET, STILL, WANDER, Task
from validate.sampled_drive.drive import Drive as SampledDrive
from validate.sampled_drive.drive import simulate as run_plant
from validate.sampled_drive.machines import draw_machine
from validate.sampled_drive.wrong_logs import command

#: Speed of the shaft of the bench's machines in rpm, and frequency of the plant's in Hz, that the
#: fractions of a task refer to.
_RPM, _HERTZ = 3000.0, 150.0
_GRID = np.linspace(-1, 1, 41)


def bench(task: Task) -> Simulated:
    """Return the log of penode's bench and its truth."""
    machine = MACHINES[task.machine]
    limit, has = machine.current_limit, task.kind
    sensors = CurrentSensors(
        gain=(1.0, GAIN if has == "sensors" else 1.0, 1.0),
        offset=(0.0, OFFSET * limit if has == "sensors" else 0.0, 0.0),
        noise=NOISE * limit,
    )
    inverter = Inverter(
        hold=StationaryHold(1.5 if has == "delay" else 0.5),
        dead_time=DeadTime(0.8e-6) if has == "inverter" else None,
        devices=DeviceDrop(0.8, soft=True) if has == "inverter" else None,
        delay=int(has == "delay"),
    )
    link = 400.0
    iron = IronLoss(link / np.sqrt(3) / (IRON * limit)) if has == "iron" else None
    drive = Drive(dc_voltage=link, inverter=inverter, current_sensors=sensors, iron_loss=iron)
    rpm = task.fraction(0.4, 0.6) * _RPM
    wanted = task.reference(limit, abs(rpm) * machine.pole_pairs / 60)

    def reference(time: FloatArray) -> FloatArray:
        rows = np.array([wanted(t) for t in time])
        return np.stack([rows.real, rows.imag], axis=-1)

    made = record(
        machine,
        reference,
        speed_rpm=rpm,
        duration=STILL + WANDER,
        drive=drive,
        seed=task.number,
    )
    c, temperature = made.experiment.channels, float(np.mean(made.truth.trace.temperature))
    current, voltage = c["i_d"] + 1j * c["i_q"], c["u_d"] + 1j * c["u_q"]
    at = limit * (_GRID[:, None] + 1j * _GRID).ravel()
    psi = np.asarray(true_flux_map(machine, at.real, at.imag))
    return Simulated(
        DriveLog(current, voltage, c["omega_el"], c["theta_el"], link),
        machine.resistance_at(temperature),
        machine.pole_pairs,
        at,
        psi[..., 0] + 1j * psi[..., 1],
    )


def plant(task: Task) -> Simulated:
    """Return the log of the plant in C and its truth."""
    machine = draw_machine(np.random.default_rng([41, int(task.machine[-1])]), frequency=_HERTZ)
    what: dict[str, dict[str, float]] = {
        "inverter": {"dead_time": 1.5e-6, "swing": 0.02, "on_state": 3e-3},
        "sensors": {"gain": GAIN, "offset": OFFSET},
        "iron": {"iron_loss": IRON},
    }
    drive = SampledDrive(noise=NOISE, **what.get(task.kind, {}))  # type: ignore[arg-type]
    count, fraction = round((STILL + WANDER) * drive.rate), task.fraction(0.4, 0.6)
    speed = np.full(count, fraction * 2 * np.pi * _HERTZ)
    wanted = task.reference(machine.rated_current, abs(fraction) * _HERTZ)

    def reference(times: FloatArray) -> np.ndarray:
        return np.array([wanted(t) for t in times])

    random = task.random(4)
    log = run_plant(machine, drive, speed, reference, random)
    if task.kind == "delay":
        log = command(log, machine, random)
    at = machine.rated_current * (_GRID[:, None] + 1j * _GRID).ravel()
    return Simulated(
        DriveLog(log.current, log.voltage, log.speed, log.angle, float(log.link[0])),
        machine.resistance,
        machine.pole_pairs,
        at,
        np.array([machine.flux(complex(i)) for i in at]),
    )
