"""Logs of motulator for PMSM-ID: ``python -m validate.pmsm_id.of_motulator``.

Runs on Python 3.12, where motulator is installed, and needs no penode.
"""

from dataclasses import replace

import numpy as np

from validate.other_simulators import motulator_drive
from validate.other_simulators.kinds import Kind
from validate.other_simulators.machines import MACHINES, MOTULATOR, Machine
from validate.other_simulators.plan import Planned
from validate.pmsm_id.simulated import Simulated, write_missing
from validate.pmsm_id.tasks import GAIN, IRON, NOISE, OFFSET, STILL, WANDER, Task

SPM = replace(MACHINES["IPM 2.2 kW"], name="SPM 2.2 kW")
WHAT: dict[str, dict[str, float]] = {
    "inverter": {"dead_time": 1.5e-6},
    "sensors": {"gain_b": GAIN, "offset_b": OFFSET},
    "iron": {"core_loss": IRON},
}


def machine_of(task: Task) -> Machine:
    """Return the machine of a task."""
    return MACHINES.get(task.machine, SPM)


def simulate(task: Task) -> Simulated:
    """Return the log of a task and its truth."""
    machine = machine_of(task)
    kind = Kind(
        task.kind,
        voltage="command" if task.kind == "delay" else "applied",
        duration=STILL + WANDER,
        drive=WHAT.get(task.kind, {}),
    )
    rpm = task.fraction(0.5, 0.7) * machine.base_rpm
    noise = NOISE * machine.current
    planned = Planned(1000 + task.number, kind, machine, (rpm,), machine.current, noise)
    reference = task.reference(machine.current, abs(rpm) * machine.pole_pairs / 60)
    speed = rpm * np.pi / 30
    run = planned, 0, reference, lambda _: speed, machine.link_voltage
    log, resistance = motulator_drive.simulate(*run)
    current, psi = motulator_drive.flux_map(machine, None)
    return Simulated(log, float(np.mean(resistance)), machine.pole_pairs, current, psi)


if __name__ == "__main__":
    write_missing({MOTULATOR: simulate})
