"""What the bench refuses before it starts, each in one sentence; the current loop's poles last."""

import math
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.bench.coenergy_table import CoenergyTable
from penode.bench.drive import Drive
from penode.bench.references import Reference
from penode.bench.rig import Rig
from penode.bench.shaft import FreeShaft, Speed
from penode.errors import InputError

_MOST_RPM = 1e6
#: Of a recording.
_MOST_SAMPLES = 10**8
#: How far a reference may exceed the machine's current limit by rounding.
_ROUNDING = 1e-9
#: Operating points of the reference at which the loop's poles are computed.
_POINTS = 16
#: Largest modulus of a pole that is let pass: a thousandth a sample grows tenfold in 2300 samples.
_LARGEST_POLE = 1.001

_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])

#: What a value must be, and whether one is that.
Rule: TypeAlias = tuple[str, Callable[[Any], bool]]


def _finite(value: Any) -> bool:
    """Return whether all numbers in a value, however nested, are finite."""
    if isinstance(value, (tuple, list)):
        return all(map(_finite, value))
    return not isinstance(value, (int, float)) or math.isfinite(value)


_FINITE: Rule = ("finite", _finite)
_POSITIVE: Rule = ("> 0", lambda x: math.isfinite(x) and x > 0)
_NOT_NEGATIVE: Rule = (">= 0", lambda x: math.isfinite(x) and x >= 0)
_THREE_POSITIVE: Rule = (
    "three numbers > 0, one a phase",
    lambda x: len(x) == 3 and _finite(x) and min(x) > 0,
)

#: The rule of a field by its name, in whichever record; all others have to be finite.
_RULES: dict[str, Rule] = {
    **dict.fromkeys(("time_step", "dc_voltage", "bandwidth", "tuning"), _POSITIVE),
    **dict.fromkeys(("current_scale", "cutoff_hz", "full_scale", "resistance"), _POSITIVE),
    **dict.fromkeys(("heat_capacity", "thermal_resistance", "inertia"), _POSITIVE),
    **dict.fromkeys(("noise", "current_noise", "duration", "friction"), _NOT_NEGATIVE),
    **dict.fromkeys(("threshold", "on_resistance"), _NOT_NEGATIVE),
    **dict.fromkeys(("gain", "phase_factors"), _THREE_POSITIVE),
    # Of a resolver, or of three current sensors.
    "offset": (
        "finite, three numbers of currents",
        lambda x: _finite(x) and (np.ndim(x) == 0 or len(x) == 3),
    ),
    "delay": ("0, 1, 2, ... samples", lambda x: isinstance(x, int) and x >= 0),
    "bits": ("a whole number from 1 to 32", lambda x: isinstance(x, int) and 1 <= x <= 32),
}


def check_drive(name: str, drive: Drive) -> None:
    """Refuse a drive with values that cannot be, such as dead time that fills the period."""
    _check_record(name, drive)
    dead_time = drive.inverter.dead_time
    if dead_time is not None and 2 * dead_time.duration >= drive.time_step:
        raise InputError(
            f"{name}: the dead time must be less than half of the switching period of "
            f"{drive.time_step:g} s, got {dead_time.duration:g} s; give it in seconds."
        )


def check_speed(name: str, speed: Speed, time: FloatArray) -> None:
    """Refuse a speed (rpm) not finite at `time` (time + 1,), s, or beyond any machine's."""
    if isinstance(speed, FreeShaft):
        _check_record(name, speed)
        return
    rpm = np.asarray(speed(time) if callable(speed) else speed, dtype=np.float64)
    if callable(speed) and rpm.shape != time.shape:
        raise InputError(
            f"{name}: the speed must be one number in rpm for each of the {len(time)} times, got "
            f"shape {rpm.shape}."
        )
    # Not a number is no number below the limit either.
    if not np.all(np.abs(rpm) <= _MOST_RPM):
        raise InputError(
            f"{name}: the speed must be finite and at most {_MOST_RPM:g} rpm, got "
            f"{np.abs(rpm).max():g} rpm."
        )


def sampling_instants(name: str, duration: float, time_step: float) -> FloatArray:
    """Return the sampling instants and the end of the last interval, (time + 1,), s."""
    if not (np.isfinite(duration) and duration >= time_step > 0):
        raise InputError(
            f"{name}: the duration must be finite and at least one time step of {time_step:g} s, "
            f"got {duration:g} s."
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
            f"{name}: the reference must be finite i_d and i_q in A for each of the {len(time)} "
            f"times, in shape {(len(time), 2)}, got shape {wanted.shape} or a number not finite."
        )
    length = np.hypot(wanted[:, 0], wanted[:, 1])
    if length.max() > current_limit * (1 + _ROUNDING):
        raise InputError(
            f"{name}: the reference must be at most the {current_limit:.4g} A that the machine "
            f"permits, got {length.max():.4g} A at t = {time[length.argmax()]:.4g} s; lower the "
            f"reference's amplitude."
        )
    return wanted


def _check_record(name: str, record: Any) -> None:
    """Raise if a number in a record, or in one that it holds, breaks its rule or is not finite."""
    for one in fields(record):
        value = getattr(record, one.name)
        wanted, holds = _RULES.get(one.name, _FINITE)
        if is_dataclass(value):
            _check_record(name, value)
        elif value is not None and not holds(value):
            raise InputError(
                f"{name}: {one.name} of {type(record).__name__} must be {wanted}, got {value!r}."
            )


def refuse_unstable(name: str, rig: Rig, wanted: FloatArray, fastest: float) -> None:
    """Refuse a loop that is unstable at the currents `wanted` (time, 2), A.

    Its poles are computed at standstill and at the electrical speed `fastest`, rad/s.
    """
    points = wanted[np.linspace(0, len(wanted) - 1, _POINTS).round().astype(int)]
    with float64():
        slopes = np.asarray(_inductances(rig.plant.table, on_device(points)))
    for point, inductance in zip(points, slopes, strict=True):
        for omega_el in (0.0, fastest):
            pole = loop_pole(rig, inductance, omega_el)
            if pole > _LARGEST_POLE:
                raise InputError(
                    f"{name}: the current loop is unstable at i_d = {point[0]:.4g} A, "
                    f"i_q = {point[1]:.4g} A and {omega_el:.4g} rad/s (a pole of modulus "
                    f"{pole:.3g}) with a bandwidth of {rig.controller.bandwidth:.4g} rad/s at a "
                    f"time step of {rig.controller.time_step:.4g} s; lower the bandwidth, the "
                    f"tuning factor or the delay."
                )


def loop_pole(rig: Rig, inductance: FloatArray, omega_el: float) -> float:
    """Return the largest modulus of the poles of the sampled loop, linearised at L (2, 2), H.

    Below 1 the loop is stable at an electrical speed, rad/s.
    """
    controller, delay = rig.controller, rig.inverter.delay
    time_step, bandwidth = controller.time_step, controller.bandwidth
    # What current and held voltage of one sample are in the current of the next.
    inverse = np.linalg.inv(inductance)
    resistance = rig.plant.copper.resistance * np.eye(2)
    both = np.zeros((4, 4))
    both[:2, :2] = -inverse @ (resistance + omega_el * _TURN @ inductance)
    both[:2, 2:] = inverse
    moved = expm(both * time_step)
    angle = -omega_el * time_step * rig.inverter.hold.mean_lag(delay)
    drive = moved[:2, 2:] @ (np.cos(angle) * np.eye(2) + np.sin(angle) * _TURN)
    believed = np.diag(controller.inductance)
    # States: current, integral, then the voltages that wait, the newest first.
    size = 4 + 2 * delay
    loop, asked = np.zeros((size, size)), np.zeros((2, size))
    loop[:2, :2] = moved[:2, :2]
    loop[2:4, :2] = -time_step * bandwidth**2 * believed
    loop[2:4, 2:4] = np.eye(2)
    asked[:, :2], asked[:, 2:4] = omega_el * _TURN @ believed - 2 * bandwidth * believed, np.eye(2)
    if delay == 0:
        loop[:2] += drive @ asked
    else:
        loop[:2, -2:] = drive
        loop[4:6] = asked
        loop[6:, 4:-2] = np.eye(size - 6)
    return float(np.abs(np.linalg.eigvals(loop)).max())


@jax.jit
def _inductances(table: CoenergyTable, currents: JaxArray) -> JaxArray:
    """Return the mean differential inductance over the angle, (point, 2, 2), of currents (A)."""
    return jax.vmap(table.mean, (0, None))(currents, jnp.zeros(())).inductance
