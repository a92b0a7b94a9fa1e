"""The time step of a recording, and the refusal of times that are not uniform."""

import numpy as np

from penode.arrays import FloatArray
from penode.data.gathered import pieces
from penode.errors import InputError

#: Fewest samples that make a recording.
MINIMUM_SAMPLES = 8
#: Largest deviation of a step from the median step, relative.
STEP_TOLERANCE = 0.01
#: Largest time in s, some 30 000 years.
LARGEST_TIME = 1e12


@np.errstate(over="ignore", invalid="ignore")  # of digits of times that are almost zero
def uniform_step(file: str, t: FloatArray) -> float:
    """Return the time step of uniformly sampled times.

    A step may deviate from the median step by 1 %. A larger deviation is accepted only where the
    times are uniform but for the digits they were written with (fixed decimals, significant
    digits or single precision), and these resolve a quarter of the step.

    Parameters
    ----------
    file : str
        File, for the messages.
    t : ndarray, shape (time,)
        Times in s, finite.

    Returns
    -------
    float
        Time step in s, ``(t[-1] - t[0]) / (len(t) - 1)``.

    Raises
    ------
    InputError
        If there are fewer than 8 samples, or the times are beyond 1e12 s, repeat, decrease, leave a
        gap or jitter; the message names the data rows (from 1, header not counted).
    """
    if len(t) < MINIMUM_SAMPLES:
        raise InputError(
            f"{file}: only {len(t)} samples came where at least {MINIMUM_SAMPLES} were wanted; "
            "record for longer."
        )
    largest = max(float(np.abs(piece).max()) for piece in pieces(t))
    if largest > LARGEST_TIME:
        raise InputError(
            f"{file}: t reaches {largest:.3g} s where at most {LARGEST_TIME:.0e} s was wanted; "
            "export t in s, or name its unit in a mapping."
        )
    least, most = _ends_of_steps(t)
    if least > 0.0 and most - least <= STEP_TOLERANCE * least:
        return float((t[-1] - t[0]) / (len(t) - 1))
    steps = np.diff(t)
    if least <= 0.0:
        raise _not_increasing(file, t, int(np.argmax(steps <= 0.0)))
    median = float(np.median(steps))
    deviation = np.abs(steps - median)
    if deviation.max() > STEP_TOLERANCE * median and not _uniform_but_for_digits(t):
        raise _irregular(file, steps, median, int(np.argmax(deviation)))
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


def _not_increasing(file: str, t: FloatArray, k: int) -> InputError:
    """Make the refusal of a time that repeats or decreases after sample k."""
    what = "repeats" if t[k + 1] == t[k] else "decreases"
    return InputError(
        f"{file}: t {what} at data row {k + 2} ({t[k]:.9g} s, then {t[k + 1]:.9g} s) where it must "
        "increase; remove the repeated or misplaced rows, or export t with more digits."
    )


def _irregular(file: str, steps: FloatArray, median: float, k: int) -> InputError:
    """Make the refusal of the step after sample k, the one furthest from the median."""
    rows = f"between data rows {k + 1} and {k + 2}"
    if steps[k] > 1.5 * median:
        missing = max(round(float(steps[k]) / median) - 1, 1)
        return InputError(
            f"{file}: t has a gap {rows}: a step of {steps[k]:.6g} s where the median is "
            f"{median:.6g} s, about {missing} missing rows; record without losses, cut the file at "
            "the gap, or export t with more digits."
        )
    return InputError(
        f"{file}: t jitters: the step {rows} is {steps[k]:.6g} s where the median is "
        f"{median:.6g} s and 1 % is allowed; resample the recording to a uniform time step, "
        "or export t with more digits."
    )
