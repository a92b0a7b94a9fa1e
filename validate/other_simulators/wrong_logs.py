"""What is wrong with a log alone: the drive ran well, its signals are not what they should be."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from validate.other_simulators.drive_log import TIME_STEP, DriveLog
from validate.other_simulators.plan import Planned

#: Changes a log, given what was planned and the number of the recording.
Change = Callable[[DriveLog, Planned, int], DriveLog]


def bases(planned: Planned) -> tuple[float, float, float]:
    """Return what a log in per unit divides by: V, A and rad/s of the electrical angle."""
    machine = planned.machine
    speed = machine.base_rpm * machine.pole_pairs * np.pi / 30
    return machine.link_voltage / np.sqrt(3), machine.current, speed


def _nothing(log: DriveLog, _planned: Planned, _part: int) -> DriveLog:
    return log


def _voltage_gain(log: DriveLog, _planned: Planned, _part: int) -> DriveLog:
    return replace(log, voltage=1.01 * log.voltage)


def _lag(log: DriveLog, _planned: Planned, _part: int) -> DriveLog:
    kept = np.exp(-2 * np.pi * 5 * TIME_STEP)
    speed = log.speed.copy()
    for k in range(1, len(speed)):
        speed[k] = kept * speed[k - 1] + (1 - kept) * log.speed[k]
    return replace(log, speed=speed)


def _reversed(log: DriveLog, _planned: Planned, _part: int) -> DriveLog:
    return replace(log, speed=-log.speed)


def _shaft(log: DriveLog, planned: Planned, _part: int) -> DriveLog:
    return replace(log, speed=log.speed / planned.machine.pole_pairs)


def _angle(log: DriveLog, _planned: Planned, _part: int) -> DriveLog:
    turn = np.exp(-1j * np.radians(2))
    angle = log.angle + np.radians(2)
    return replace(log, current=turn * log.current, voltage=turn * log.voltage, angle=angle)


def _per_unit(log: DriveLog, planned: Planned, _part: int) -> DriveLog:
    volt, ampere, speed = bases(planned)
    return replace(
        log,
        voltage=log.voltage / volt,
        current=log.current / ampere,
        speed=log.speed / speed,
        link=log.link / volt,
    )


def _spike(log: DriveLog, planned: Planned, part: int) -> DriveLog:
    current = log.current.copy()
    current[planned.random(20 + part).integers(len(current))] += 1e6j
    return replace(log, current=current)


def _noise(log: DriveLog, planned: Planned, part: int) -> DriveLog:
    random, size = planned.random(20 + part), len(log.speed)
    drawn = random.normal(size=(4, size))
    return replace(
        log,
        current=0.3 * planned.amplitude * (drawn[0] + 1j * drawn[1]),
        voltage=0.1 * planned.machine.link_voltage * (drawn[2] + 1j * drawn[3]),
    )


WRONG: dict[str, Change] = {
    "": _nothing,
    "voltage gain": _voltage_gain,
    "lag": _lag,
    "reversed": _reversed,
    "shaft": _shaft,
    "angle": _angle,
    "per unit": _per_unit,
    "spike": _spike,
    "noise": _noise,
}
