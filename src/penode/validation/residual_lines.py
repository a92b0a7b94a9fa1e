"""Lines of a residual's spectrum: what stands out of the floor of noise."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from penode.arrays import BoolArray, ComplexArray, FloatArray, IntArray

#: Frequencies around one whose median is its floor.
_NEIGHBOURHOOD = 401
#: Chance that white noise shows a line in a recording.
_FALSE_ALARM = 0.01
#: Significant frequencies closer than this many bins, or this share of the base, are one line.
_GAP, _GAP_SHARE = 4, 0.05


@dataclass(frozen=True)
class Line:
    """A line that stands out of the one-step residual's spectrum.

    Attributes
    ----------
    signal : int
        Column of the power.
    frequency : float
        Its centre of power in Hz, signed where two states are one complex signal.
    low, high : float
        Where it begins and ends, Hz: a line whose size changes slowly is smeared.
    amplitude : float
        Of the sinusoid, the rotating vector or the offset with the same power, in SI units.
    share : float
        Of its signal's mean squared one-step residual.
    order : float or None
        Frequency over the base frequency; None without one.
    """

    signal: int
    frequency: float
    low: float
    high: float
    amplitude: float
    share: float
    order: float | None


def power_spectrum(signal: ComplexArray | FloatArray) -> FloatArray:
    """Return the mean square of each frequency, under a Hann window.

    Parameters
    ----------
    signal : ndarray, shape (time, signal)
        Real or complex.

    Returns
    -------
    ndarray, shape (time, signal)
        At the frequencies of ``numpy.fft.fftfreq``; their sum is the signal's mean square.
    """
    taper = np.hanning(len(signal) + 1)[:-1, None]
    spectrum = np.fft.fft(signal * taper, axis=0)
    return np.asarray(np.abs(spectrum) ** 2 / (len(signal) * np.sum(taper**2)))


def find_lines(
    frequency: FloatArray, power: FloatArray, base: float | None = None
) -> tuple[Line, ...]:
    """Return the lines that stand out of the floor, strongest first.

    The floor is the running median over 401 frequencies. Of white noise each frequency is
    exponentially distributed about it, and the threshold is set for one false line in a hundred
    recordings.

    Parameters
    ----------
    frequency : ndarray, shape (frequency,)
        Hz, ascending, evenly spaced.
    power : ndarray, shape (frequency, signal)
        Mean squares.
    base : float, optional
        Frequency in Hz whose multiples are the orders.
    """
    resolution = float(frequency[1] - frequency[0])
    reach = max(_GAP * resolution, _GAP_SHARE * abs(base or 0.0))
    lines = []
    for signal, column in enumerate(power.T):
        for run in _runs(frequency, _significant(column, frequency), reach):
            part, total = column[run], column.sum()
            centre = float(np.average(frequency[run], weights=part))
            turns = frequency[0] < 0 or frequency[run[0]] == 0
            lines.append(
                Line(
                    signal=signal,
                    frequency=centre,
                    low=float(frequency[run[0]]),
                    high=float(frequency[run[-1]]),
                    amplitude=float(np.sqrt(part.sum() * (1.0 if turns else 2.0))),
                    share=float(part.sum() / total),
                    order=centre / base if base else None,
                )
            )
    return tuple(sorted(lines, key=lambda line: -line.share))


def _significant(power: FloatArray, frequency: FloatArray) -> BoolArray:
    """Return which frequencies stand out of the floor."""
    width = min(_NEIGHBOURHOOD, len(power) // 2 * 2 - 1)
    floor = median_filter(power, width, mode="wrap" if frequency[0] < 0 else "mirror") / np.log(2)
    threshold = np.log(len(power) / _FALSE_ALARM) * np.maximum(floor, 1e-300)
    # At zero and at half the rate the residual has no phase: chi-squared of one, not of two.
    flat = (frequency == 0) | (np.abs(frequency) == np.abs(frequency).max())
    return np.asarray(power > np.where(flat, 2.0, 1.0) * threshold)


def _runs(frequency: FloatArray, chosen: BoolArray, reach: float) -> list[IntArray]:
    """Return the indices of each run of chosen frequencies, gaps up to `reach` Hz closed."""
    indices = np.flatnonzero(chosen)
    ends = np.flatnonzero(np.diff(frequency[indices]) > reach) + 1
    return [np.arange(part[0], part[-1] + 1) for part in np.split(indices, ends) if len(part)]
