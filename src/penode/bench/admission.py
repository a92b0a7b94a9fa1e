"""What the bench refuses before it starts, each in one sentence."""

import math
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any, TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.bench.current_sensors import CurrentSensors, Quantisation
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, DeviceDrop, Inverter
from penode.bench.references import Reference
from penode.bench.sensors import SpeedSensor
from penode.bench.shaft import FreeShaft, Speed
from penode.bench.winding import IronLoss, Warming, Winding
from penode.errors import InputError

_MOST_RPM = 1e6
#: Of a recording.
_MOST_SAMPLES = 10**8

# A rule says what was wanted, and whether a value is that.
Rule: TypeAlias = tuple[str, Callable[[Any], bool]]

_POSITIVE: Rule = ("a number above zero", lambda x: math.isfinite(x) and x > 0)
_NOT_NEGATIVE: Rule = ("a number not below zero", lambda x: math.isfinite(x) and x >= 0)
_THREE_POSITIVE: Rule = (
    "three numbers above zero, one a phase",
    lambda x: len(x) == 3 and all(math.isfinite(one) and one > 0 for one in x),
)
_THREE: Rule = (
    "three finite numbers, one a phase",
    lambda x: len(x) == 3 and all(math.isfinite(one) for one in x),
)

_RULES: dict[type, dict[str, Rule]] = {
    Drive: {
        "time_step": _POSITIVE,
        "dc_voltage": _POSITIVE,
        "bandwidth": _POSITIVE,
        "tuning": _POSITIVE,
        "current_noise": _NOT_NEGATIVE,
    },
    Inverter: {"delay": ("0, 1, 2, ... samples", lambda x: isinstance(x, int) and x >= 0)},
    DeadTime: {"duration": _NOT_NEGATIVE, "current_scale": _POSITIVE},
    DeviceDrop: {
        "threshold": _NOT_NEGATIVE,
        "on_resistance": _NOT_NEGATIVE,
        "current_scale": _POSITIVE,
        "phase_factors": _THREE_POSITIVE,
    },
    CurrentSensors: {
        "gain": _THREE_POSITIVE,
        "offset": _THREE,
        "noise": _NOT_NEGATIVE,
        "cutoff_hz": _POSITIVE,
    },
    Quantisation: {
        "full_scale": _POSITIVE,
        "bits": ("a whole number from 1 to 32", lambda x: isinstance(x, int) and 1 <= x <= 32),
    },
    SpeedSensor: {"noise": _NOT_NEGATIVE},
    Winding: {"phase_factors": _THREE_POSITIVE},
    Warming: {"heat_capacity": _POSITIVE, "thermal_resistance": _POSITIVE},
    IronLoss: {"resistance": _POSITIVE},
    FreeShaft: {"inertia": _POSITIVE, "friction": _NOT_NEGATIVE},
}

# How far a reference may exceed the machine's current limit by rounding.
_ROUNDING = 1e-9


def check_drive(name: str, drive: Drive) -> None:
    """Refuse a drive with values that cannot be, such as dead time that fills the period."""
    for record in _records(drive):
        _check_record(name, record)
    dead_time = drive.inverter.dead_time
    if dead_time is not None and 2 * dead_time.duration >= drive.time_step:
        raise InputError(
            f"{name}: a dead time of {dead_time.duration:g} s was given for a switching period of "
            f"{drive.time_step:g} s; give one in seconds that is less than half of the period."
        )


def check_speed(name: str, speed: Speed, time: FloatArray) -> None:
    """Refuse a speed (rpm) not finite at `time` (time + 1,), s, or beyond any machine's."""
    if isinstance(speed, FreeShaft):
        _check_record(name, speed)
        return
    rpm = np.asarray(speed(time) if callable(speed) else speed, dtype=np.float64)
    if callable(speed) and rpm.shape != time.shape:
        raise InputError(
            f"{name}: the speed came in shape {rpm.shape}; return one in revolutions per minute "
            f"for each of the {len(time)} times."
        )
    if not np.all(np.isfinite(rpm)):
        raise InputError(f"{name}: the speed is not finite; give it in revolutions per minute.")
    if np.abs(rpm).max() > _MOST_RPM:
        raise InputError(
            f"{name}: a speed of {np.abs(rpm).max():g} rpm came; give at most {_MOST_RPM:g} rpm."
        )


def sampling_instants(name: str, duration: float, time_step: float) -> FloatArray:
    """Return the sampling instants and the end of the last interval, (time + 1,), s."""
    if not (np.isfinite(duration) and duration >= time_step > 0):
        raise InputError(
            f"{name}: {duration:g} s hold no sample at a time step of {time_step:g} s; "
            f"give a duration and a time step above zero, the duration being the longer."
        )
    if duration / time_step > _MOST_SAMPLES:
        raise InputError(
            f"{name}: {duration:g} s at a time step of {time_step:g} s are more than "
            f"{_MOST_SAMPLES:.0e} samples; give a shorter duration."
        )
    return time_step * np.arange(round(duration / time_step) + 1, dtype=np.float64)


def reference_rows(
    name: str, reference: Reference, time: FloatArray, current_limit: float
) -> FloatArray:
    """Return the reference i_d, i_q at `time` (time,), s, as (time, 2), A.

    Refused if it has another shape, is not finite or longer than `current_limit`, A.
    """
    wanted = np.asarray(reference(time), dtype=np.float64)
    if wanted.shape != (len(time), 2) or not np.all(np.isfinite(wanted)):
        raise InputError(
            f"{name}: the reference came in shape {wanted.shape}, or not finite; return finite i_d "
            f"and i_q in A for each of the {len(time)} times, in shape {(len(time), 2)}."
        )
    length = np.hypot(wanted[:, 0], wanted[:, 1])
    if length.max() > current_limit * (1 + _ROUNDING):
        raise InputError(
            f"{name}: the reference asks for {length.max():.4g} A at t = "
            f"{time[length.argmax()]:.4g} s where the machine permits {current_limit:.4g} A; "
            f"lower the reference's amplitude."
        )
    return wanted


def _records(record: Any) -> Iterator[Any]:
    """Yield a record and all records in its fields."""
    yield record
    for one in fields(record):
        value = getattr(record, one.name)
        if is_dataclass(value):
            yield from _records(value)


def _check_record(name: str, record: Any) -> None:
    """Raise if a field of a record breaks its rule, or holds a number that is not finite."""
    rules = _RULES.get(type(record), {})
    for one in fields(record):
        value = getattr(record, one.name)
        if value is None or is_dataclass(value):
            continue
        wanted, holds = rules.get(one.name, ("finite numbers", _finite))
        if not holds(value):
            raise InputError(
                f"{name}: {type(record).__name__} came with {one.name} = {value!r}; give {wanted}."
            )


def _finite(value: Any) -> bool:
    """Return whether all numbers in a value, however nested, are finite."""
    if isinstance(value, (tuple, list)):
        return all(_finite(one) for one in value)
    return not isinstance(value, (int, float)) or math.isfinite(value)
