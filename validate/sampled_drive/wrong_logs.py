"""What a data logger, or a wrong convention, makes of a log."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from validate.sampled_drive.log import Log
from validate.sampled_drive.machines import Machine

Random = np.random.Generator


def every(count: int) -> Callable[[Log, Machine, Random], Log]:
    """Return a logger that keeps one of `count` rows."""
    return lambda log, _machine, _random: log.rows(slice(None, None, count))


def means_of_5(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return means of 5 rows each."""
    return log.means(5)


def command(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log with voltages at the sample that they were computed from."""
    return replace(log.rows(slice(None, -1)), voltage=log.voltage[1:])


def lost_rows(log: Log, _machine: Machine, random: Random) -> Log:
    """Return the log without 0.5 % of its rows."""
    return log.rows(random.random(len(log.time)) >= 0.005)


def jitter(log: Log, _machine: Machine, random: Random) -> Log:
    """Return the log with stamps that scatter by 5 % of a period."""
    period = log.time[1] - log.time[0]
    return replace(log, time=log.time + 0.05 * period * random.normal(size=len(log.time)))


def in_kiloamperes(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log with currents in kA."""
    return replace(log, current=1e-3 * log.current)


def exchanged_phases(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log of a logger that takes current b for c; it computes dq by itself."""
    return replace(log, current=np.conj(log.current) * np.exp(-2j * log.angle))


def _exchanged_axes(some: np.ndarray) -> np.ndarray:
    return 1j * np.conj(some)


def swapped(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log with d and q exchanged, voltages and currents."""
    return replace(log, current=_exchanged_axes(log.current), voltage=_exchanged_axes(log.voltage))


def swapped_currents(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log with i_d and i_q exchanged."""
    return replace(log, current=_exchanged_axes(log.current))


def noise(log: Log, machine: Machine, random: Random) -> Log:
    """Return noise in place of voltages and currents."""
    drawn = random.normal(size=(4, len(log.time)))
    return replace(
        log,
        current=0.3 * machine.rated_current * (drawn[0] + 1j * drawn[1]),
        voltage=0.2 * machine.rated_voltage * (drawn[2] + 1j * drawn[3]),
    )


def shaft_speed(log: Log, machine: Machine, _random: Random) -> Log:
    """Return the log with the shaft's speed in place of the electrical one."""
    return replace(log, speed=log.speed / machine.pole_pairs)


def shaft_speed_no_angle(log: Log, machine: Machine, random: Random) -> Log:
    """Return the log with the shaft's speed and no angle."""
    return replace(shaft_speed(log, machine, random), without=("theta_el",))


def pole_pairs_4_for_5(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log with speed and angle of the shaft times 4 in place of 5 pole pairs."""
    return replace(log, speed=0.8 * log.speed, angle=0.8 * log.angle)


def pole_pairs_4_for_5_no_angle(log: Log, machine: Machine, random: Random) -> Log:
    """Return the log with the speed of the shaft times 4 in place of 5, and no angle."""
    return replace(pole_pairs_4_for_5(log, machine, random), without=("theta_el",))


def reversed_speed(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log with a speed of the other sign."""
    return replace(log, speed=-log.speed)


def degrees(log: Log, _machine: Machine, _random: Random) -> Log:
    """Return the log with its angle in degrees."""
    return replace(log, turn=360.0)
