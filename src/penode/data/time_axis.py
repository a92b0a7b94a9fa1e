"""Times: the step of a recording, gaps in it, what is not uniform, one clock for several rates."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray, IntArray
from penode.data.gathered import pieces
from penode.errors import InputError

#: Fewest samples that make a recording.
MINIMUM_SAMPLES = 8
#: Largest deviation of a step from the median step, relative.
STEP_TOLERANCE = 0.01
#: Step over the median step from which rows are missing.
_GAP = 1.5
#: Part of a step that is rounding.
_ROUNDING = 1e-6
#: Largest time in s, some 30 000 years.
LARGEST_TIME = 1e12
#: Rows before and after a gap by which it is seen among stamps that jitter.
_NEAR = 50
#: Another repair of stamps, where a steady clock sampled.
_STEADY = (
    "; where a steady clock sampled and only the stamps jitter, give its step in s as time_step, "
    "in a study file above [channels]"
)
# Largest turn in rad between two samples of an angle that can still be interpolated.
_LARGEST_TURN = np.pi / 2


@dataclass(frozen=True, eq=False)
class Sampled:
    """SI values of one channel and their times in s, both of shape (time,)."""

    times: FloatArray
    values: FloatArray
    is_angle: bool


def uniform_stretches(
    file: str, t: FloatArray, shortest: int
) -> tuple[float, tuple[tuple[int, int], ...]]:
    """Return the step in s of times that are uniform but for gaps, and the stretches between these.

    A stretch is its first sample and last plus one; those of fewer than ``shortest`` samples are
    left out. Refuses times as `uniform_step` does, gaps only where such stretches hold less than
    half of the samples, and steps that differ by more than 1 % between stretches.
    """
    gaps = gaps_in(t)
    ends = zip([0, *(gaps + 1)], [*(gaps + 1), len(t)], strict=True)
    spans = tuple((int(a), int(b)) for a, b in ends if b - a >= shortest)
    if not len(gaps) or 2 * sum(b - a for a, b in spans) < len(t):
        return uniform_step(file, t), ((0, len(t)),)
    steps = np.array([uniform_step(file, t[a:b], a) for a, b in spans])
    odd = int(np.argmax(np.abs(steps - steps[0])))
    if abs(steps[odd] - steps[0]) > STEP_TOLERANCE * steps[0]:
        raise InputError(
            f"{file}: the time step is {steps[0]:.6g} s from data row {spans[0][0] + 1} and "
            f"{steps[odd]:.6g} s from data row {spans[odd][0] + 1}; export each rate to a file of "
            "its own."
        )
    lengths = np.array([b - a - 1 for a, b in spans])
    return float(steps @ lengths / lengths.sum()), spans


def gaps_in(t: FloatArray) -> IntArray:
    """Return the samples after which rows are missing; none where the times do not increase."""
    none = np.empty(0, dtype=np.int64)
    if len(t) < MINIMUM_SAMPLES:
        return none
    least, most = _ends_of_steps(t)
    if not 0.0 < least < most / _GAP:
        return none
    steps = np.diff(t)
    return np.flatnonzero(steps > _GAP * np.median(steps))


def regular_times(t: FloatArray) -> FloatArray:
    """Return uniform times over the time, in s, that jittering ones cover between their gaps.

    The same come back where they are uniform but for gaps, or do not increase.
    """
    if len(t) < MINIMUM_SAMPLES or not _ends_of_steps(t)[0] > 0.0:
        return t
    gaps = gaps_in(t)
    spans = np.split(t, gaps + 1)
    if all(_is_uniform(span) for span in spans if len(span) >= MINIMUM_SAMPLES):
        return t
    own = [np.ptp(span) / max(len(span) - 1, 1) for span in spans]
    whole = float(np.sum([np.ptp(span) for span in spans]) / (len(t) - len(spans)))
    # Stretches of other rates keep theirs, by which they are refused.
    steps = [step if abs(step - whole) > STEP_TOLERANCE * whole else whole for step in own]
    grids = [
        span[0] + step * np.arange(int(np.ptp(span) / step + _ROUNDING) + 1) if step else span
        for span, step in zip(spans, steps, strict=True)
    ]
    return np.concatenate(grids)


def is_uneven(t: FloatArray) -> bool:
    """Return whether times of any unit repeat, or jitter between their gaps; none may decrease."""
    if len(t) < MINIMUM_SAMPLES:
        return False
    least = _ends_of_steps(t)[0]
    return least == 0.0 or (least > 0.0 and regular_times(t) is not t)


def steady_times(file: str, t: FloatArray, step: float) -> FloatArray:
    """Return the times in s of rows that a steady clock of a known step took, stamped unevenly.

    A stamp is late by what a computer took, or rounded: rows are missing where all stamps that
    follow are later, by a step, than the earliest before. Refused are stamps that decrease, and
    that are not one step apart within 1 %.
    """
    if len(t) < MINIMUM_SAMPLES:
        return t
    steps = np.diff(t)
    if steps.min() < 0.0:
        raise _not_increasing(file, t, int(np.argmax(steps < 0.0)), 0)
    late = (t - t[0]) / step - np.arange(len(t))
    apart = min(_NEAR, len(t) // 2)
    earliest = _least_ahead(late, apart)
    pace = 1.0 + float(np.median(earliest[apart:] - earliest[:-apart])) / apart
    if abs(pace - 1.0) > STEP_TOLERANCE:
        raise InputError(
            f"{file}: time_step is {step:.6g} s in the study file, and the rows of t are "
            f"{pace * step:.6g} s apart; set time_step to what the drive samples at, or remove it."
        )
    return np.asarray(t[0] + step * (np.arange(len(t)) + np.cumsum(_rows_missing(late, apart))))


def _rows_missing(late: FloatArray, apart: int) -> FloatArray:
    """Return how many rows are missing in front of each, of stamps that are so many rows late."""
    missing = np.zeros(len(late))
    while True:
        left = late - np.cumsum(missing)
        before = np.roll(_least_ahead(left[::-1], apart)[::-1], 1)
        rise = np.floor(_least_ahead(left, apart) - before + 0.25)
        rise[0] = 0.0
        begins = (rise > 0) & ~np.r_[False, rise[:-1] > 0]
        if not begins.any():
            return missing
        missing[begins] += rise[begins]


def _least_ahead(values: FloatArray, count: int) -> FloatArray:
    """Return the least of each value and those that follow it, so many in all."""
    from scipy.ndimage import minimum_filter1d

    return np.asarray(minimum_filter1d(values, count, origin=-(count // 2), mode="nearest"))


@np.errstate(over="ignore", invalid="ignore")  # of digits of times that are almost zero
def _is_uniform(t: FloatArray) -> bool:
    """Return whether no step deviates from the median step by more than digits and 1 % explain."""
    steps = np.diff(t)
    median = float(np.median(steps))
    return bool(np.abs(steps - median).max() <= STEP_TOLERANCE * median) or (
        _uniform_but_for_digits(t)
    )


def uniform_step(file: str, t: FloatArray, before: int = 0) -> float:
    """Return the time step in s of uniformly sampled times in s.

    A step may deviate from the median step by 1 %. A larger deviation is accepted only where the
    times are uniform but for the digits they were written with (fixed decimals, significant digits
    or single precision), and these resolve a quarter of the step.

    Refuses fewer than 8 samples, and times that are beyond 1e12 s, repeat, decrease, leave a gap or
    jitter; the message names the data rows, of which ``before`` come earlier in the file.
    """
    if len(t) < MINIMUM_SAMPLES:
        raise InputError(
            f"{file}: a recording must have at least {MINIMUM_SAMPLES} samples, got {len(t)}; "
            "record for longer."
        )
    largest = max(float(np.abs(piece).max()) for piece in pieces(t))
    if largest > LARGEST_TIME:
        raise InputError(
            f"{file}: t must be at most {LARGEST_TIME:.0e} s, got {largest:.3g} s; export t in "
            "s, or name its unit in a mapping."
        )
    least, most = _ends_of_steps(t)
    if least > 0.0 and most - least <= STEP_TOLERANCE * least:
        return float((t[-1] - t[0]) / (len(t) - 1))
    steps = np.diff(t)
    if least <= 0.0:
        raise _not_increasing(file, t, int(np.argmax(steps <= 0.0)), before)
    if not _is_uniform(t):
        deviation = np.abs(steps - np.median(steps))
        raise _irregular(file, steps, int(np.argmax(deviation)), before)
    return float((t[-1] - t[0]) / (len(t) - 1))


def _ends_of_steps(t: FloatArray) -> tuple[float, float]:
    """Return the smallest and the largest step between times."""
    before, ends = t[:1], []
    for piece in pieces(t[1:]):
        steps = np.diff(piece, prepend=before)
        before = piece[-1:].copy()
        ends += [float(steps.min()), float(steps.max())]
    return min(ends), max(ends)


def _uniform_but_for_digits(t: FloatArray) -> bool:
    """Return whether the times are a uniform grid, rounded to the digits they show.

    Rounding errors do not add up: the times stay within half a quantum of a straight line, while
    a missing row or a jittering clock leaves it.
    """
    quantum = _quantum(t)
    index = np.arange(len(t)) - (len(t) - 1) / 2
    centred = t - t.mean()
    step = float(index @ centred / (index @ index))
    if quantum > step / 4:
        return False
    spread = np.ptp(centred - step * index)
    # One quantum of rounding, and half of one for the error of the line's slope.
    return bool(spread <= STEP_TOLERANCE * step + 1.5 * quantum)


def _quantum(t: FloatArray) -> float:
    """Return the coarsest resolution in s that the values of the times betray."""
    largest = np.abs(t).max()
    single = np.float32(largest)
    is_single = bool((t.astype(np.float32) == t).all())
    binary = float(np.spacing(single if is_single else largest))
    return max(binary, _decimal_quantum(t), _significant_quantum(t))


def _decimal_quantum(t: FloatArray) -> float:
    """Return the last decimal place in use, 0 if the times have more than 12."""
    for decimals in range(13):
        if (np.round(t, decimals) == t).all():
            return float(10.0**-decimals)
    return 0.0


def _significant_quantum(t: FloatArray) -> float:
    """Return the last place of the largest time, 0 if more than 9 significant digits are in use."""
    size = np.abs(t[t != 0.0])
    exponent = np.floor(np.log10(size))
    for digits in range(3, 10):
        scaled = size * 10.0 ** (digits - 1 - exponent)
        if (np.abs(scaled - np.rint(scaled)) < 1e-6).all():
            return float(10.0 ** (exponent.max() + 1 - digits))
    return 0.0


def _not_increasing(file: str, t: FloatArray, k: int, before: int) -> InputError:
    """Make the refusal of a time that repeats or decreases after sample k."""
    what = "repeats" if t[k + 1] == t[k] else "decreases"
    return InputError(
        f"{file}: t {what} at data row {before + k + 2} ({t[k]:.9g} s, then "
        f"{t[k + 1]:.9g} s) where it must increase; remove the repeated or misplaced rows, or "
        f"export t with more digits{_STEADY if what == 'repeats' else ''}."
    )


def _irregular(file: str, steps: FloatArray, k: int, before: int) -> InputError:
    """Make the refusal of the step after sample k, the one furthest from the median."""
    rows = f"between data rows {before + k + 1} and {before + k + 2}"
    median = float(np.median(steps))
    if steps[k] > _GAP * median:
        missing = max(round(float(steps[k]) / median) - 1, 1)
        return InputError(
            f"{file}: t has a gap {rows}: a step of {steps[k]:.6g} s where the median is "
            f"{median:.6g} s, about {missing} missing rows; record without losses, cut the file at "
            f"the gap, or export t with more digits{_STEADY}."
        )
    return InputError(
        f"{file}: t jitters: the step {rows} is {steps[k]:.6g} s where the median is "
        f'{median:.6g} s and 1 % is allowed; ask for resample = "linear" in the study file, '
        f"or export t with more digits{_STEADY}."
    )


# --- one clock for several ----------------------------------------------------------------------


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
    clocks = {name: sampled[name].times for name in others}
    odd = [n for n, own in clocks.items() if own is not times and not np.array_equal(own, times)]
    if not odd:
        uniform = regular_times(times) if resample else times
        return uniform, {n: _at(file, n, uniform, channel) for n, channel in sampled.items()}
    if not resample:
        raise InputError(
            f"{file}: channel {first} has {_pace(times)} and channel {odd[0]} "
            f'{_pace(clocks[odd[0]])}; ask for resample = "linear", which interpolates '
            "all channels at the times of the fastest."
        )
    clocks = {name: regular_times(channel.times) for name, channel in sampled.items()}
    steps = {name: uniform_step(file, clock) for name, clock in clocks.items()}
    fastest = min(steps, key=lambda name: steps[name])
    times, slack = clocks[fastest], _ROUNDING * steps[fastest]
    begin = max(channel.times[0] for channel in sampled.values()) - slack
    end = min(channel.times[-1] for channel in sampled.values()) + slack
    times = times[(times >= begin) & (times <= end)]
    return times, {name: _at(file, name, times, channel) for name, channel in sampled.items()}


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
                f"less than {_LARGEST_TURN:.3g} can be interpolated; record it faster."
            )
    return np.asarray(np.interp(times, channel.times, values))
