"""What is left in the one-step residual: its spectrum."""

from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.validation.free_run import Comparison


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Amplitude spectrum of the one-step residual of one recording.

    Attributes
    ----------
    recording : str
        Where the residual is from.
    frequency : ndarray, shape (frequency,)
        Hz, from zero to half the sampling rate.
    amplitude : ndarray, shape (frequency, state)
        Peak amplitude in the state's unit (Hann window, corrected for its coherent gain).
    """

    recording: str
    frequency: FloatArray
    amplitude: FloatArray


def residual_spectrum(comparison: Comparison) -> Spectrum:
    """Return the spectrum of measured minus one-step prediction.

    Parameters
    ----------
    comparison : Comparison
        Its first row, which has no prediction, is left out.
    """
    residual = (comparison.measured - comparison.one_step)[1:]
    taper = np.hanning(len(residual) + 1)[:-1]
    lines = np.fft.rfft(residual * taper[:, None], axis=0)
    frequency = np.asarray(np.fft.rfftfreq(len(residual), comparison.time_step), dtype=np.float64)
    harmonic = np.arange(len(frequency))
    sides = np.where((harmonic > 0) & (2 * harmonic < len(residual)), 2.0, 1.0)
    amplitude = sides[:, None] * np.abs(lines) / taper.sum()
    return Spectrum(comparison.name, frequency, amplitude)
