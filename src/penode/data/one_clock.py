"""One clock for channels that were sampled at several."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.time_axis import gaps_in, regular_times, uniform_step
from penode.errors import InputError

# Largest turn in rad between two samples of an angle that can still be interpolated.
_LARGEST_TURN = np.pi / 2
# Samples this close to the end of another clock, in time steps, are within it.
_CLOCK_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Sampled:
    """SI values of one channel and their times in s, both of shape (time,)."""

    times: FloatArray
    values: FloatArray
    is_angle: bool


def on_one_clock(
    file: str, sampled: Mapping[str, Sampled], resample: bool
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the common times in s and the channels at them.

    ``resample`` allows interpolation at the times of the fastest channel, or at uniform ones where
    these jitter. Refuses clocks that differ without it, a gap in the times of one of several, and
    an angle that turns too far in a sample to be interpolated.
    """
    first, *others = sampled
    times = sampled[first].times
    odd = [name for name in others if not _same(sampled[name].times, times)]
    if not odd:
        uniform = regular_times(times) if resample else times
        return uniform, {n: _at(file, n, uniform, channel) for n, channel in sampled.items()}
    if not resample:
        raise InputError(
            f"{file}: channel {first} has {_pace(times)} and channel {odd[0]} "
            f'{_pace(sampled[odd[0]].times)}; ask for resample = "linear", which interpolates '
            "all channels at the times of the fastest."
        )
    clocks = {name: regular_times(channel.times) for name, channel in sampled.items()}
    steps = {name: uniform_step(file, clock) for name, clock in clocks.items()}
    fastest = min(steps, key=lambda name: steps[name])
    times, slack = clocks[fastest], _CLOCK_ROUNDING * steps[fastest]
    begin = max(channel.times[0] for channel in sampled.values()) - slack
    end = min(channel.times[-1] for channel in sampled.values()) + slack
    times = times[(times >= begin) & (times <= end)]
    return times, {name: _at(file, name, times, channel) for name, channel in sampled.items()}


def _same(times: FloatArray, others: FloatArray) -> bool:
    return times is others or np.array_equal(times, others)


def _pace(times: FloatArray) -> str:
    step = (times[-1] - times[0]) / max(len(times) - 1, 1)
    return f"{len(times)} samples, one every {step:.6g} s from {times[0]:.6g} s"


def _at(file: str, name: str, times: FloatArray, channel: Sampled) -> FloatArray:
    """Interpolate a channel linearly; an angle is unwrapped first where it has to be."""
    values = channel.values
    if times is channel.times:
        return values
    inside = np.isin(times, channel.times)
    if inside.all():
        return values[np.isin(channel.times, times)]
    if channel.is_angle:
        values = np.unwrap(values)
        turn = float(np.abs(np.delete(np.diff(values), gaps_in(channel.times))).max())
        if turn > _LARGEST_TURN:
            raise InputError(
                f"{file}: channel {name} turns {turn:.3g} rad between two of its samples where "
                f"less than {_LARGEST_TURN:.3g} was wanted to interpolate it; record it faster."
            )
    return np.asarray(np.interp(times, channel.times, values))
