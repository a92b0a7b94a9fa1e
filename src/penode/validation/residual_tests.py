"""What is left in the one-step residual: its spectrum, and its correlations."""

from dataclasses import dataclass, field

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.validation.comparison import Comparison


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

    recording: str = ""
    frequency: FloatArray = field(default_factory=lambda: np.empty(0))
    amplitude: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


#: Lags of the correlations, and the two-sided 99 % point of the normal distribution.
LAGS = 60
_LIMIT = 2.576


@dataclass(frozen=True, eq=False)
class Correlations:
    """Correlations of the one-step residual with itself and with the inputs.

    Attributes
    ----------
    recording : str
        Where the residual is from.
    states, inputs : tuple of str
        Names of the states that are predicted, and of the inputs that move.
    own : ndarray, shape (lag, state)
        Autocorrelation of each state's residual at lags 0, 1, ...
    own_limit : float
        99 % of the autocorrelations of white noise are smaller.
    cross : ndarray, shape (lag, state, input)
        Correlation of the residual with the input `lag` samples before; lags 0, 1, ...
    cross_limit : ndarray, shape (state, input)
        99 % of the correlations of an unrelated residual with the same autocorrelation are smaller.
    """

    recording: str = ""
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    own: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    own_limit: float = np.inf
    cross: FloatArray = field(default_factory=lambda: np.empty((0, 0, 0)))
    cross_limit: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


def residual_correlations(
    comparison: Comparison, experiment: Experiment, inputs: tuple[str, ...]
) -> Correlations:
    """Test the one-step residual for whiteness and for what it still has of the inputs.

    The limits are those of residual analysis (Ljung, System Identification, 1999, section 16.6):
    1/sqrt(N) for the autocorrelation of white noise, and the root of
    sum_l r_e(l) r_u(l) / N for the correlation with an input.

    Parameters
    ----------
    comparison : Comparison
        Its first row, which has no prediction, is left out; so are states without prediction.
    experiment : Experiment
        The same recording.
    inputs : tuple of str
        Channels to compare with; those that stand still are left out.
    """
    residual = comparison.one_step_residual
    predicted = np.flatnonzero(np.isfinite(residual).all(axis=0))
    if not len(predicted):
        return Correlations(comparison.name)
    moving = tuple(name for name in inputs if np.ptp(experiment.channels[name][:-1]) > 0)
    count = len(residual)
    lags = min(LAGS, count // 4)
    errors = [_normalised(column) for column in residual.T[predicted]]
    drives = [_normalised(experiment.channels[name][:-1]) for name in moving]
    own = np.stack([_lagged(e, e) for e in errors], axis=-1)
    drive = [_lagged(u, u) for u in drives]
    cross = [[_lagged(e, u)[:lags] for u in drives] for e in errors]
    shared = [[_overlap(own[:, k], auto) / count for auto in drive] for k in range(len(errors))]
    shape = (lags, len(errors), len(moving))
    return Correlations(
        recording=comparison.name,
        states=tuple(comparison.states[k] for k in predicted),
        inputs=moving,
        own=own[:lags],
        own_limit=_LIMIT / np.sqrt(count),
        cross=np.moveaxis(np.array(cross), -1, 0) if moving else np.empty(shape),
        cross_limit=_LIMIT * np.sqrt(np.array(shared).reshape(shape[1:])),
    )


def _normalised(signal: FloatArray) -> FloatArray:
    """Return the signal less its mean, of length 1."""
    centred = signal - signal.mean()
    return np.asarray(centred / max(float(np.linalg.norm(centred)), 1e-300))


def _lagged(late: FloatArray, early: FloatArray) -> FloatArray:
    """Return sum_t late(t) early(t - lag) for lags 0, 1, ... up to a quarter of the length."""
    size = 2 * len(late)
    spectrum = np.fft.rfft(late, size) * np.conj(np.fft.rfft(early, size))
    return np.asarray(np.fft.irfft(spectrum, size)[: len(late) // 4])


def _overlap(one: FloatArray, other: FloatArray) -> float:
    """Return the sum over positive and negative lags of the product, at least that of lag 0."""
    product = one * other
    taper = 1 - np.arange(len(product)) / len(product)
    return max(float(product[0] + 2 * taper[1:] @ product[1:]), float(product[0]))


def residual_spectrum(comparison: Comparison) -> Spectrum:
    """Return the spectrum of measured minus one-step prediction.

    Parameters
    ----------
    comparison : Comparison
        Its first row, which has no prediction, is left out.
    """
    residual = comparison.one_step_residual
    taper = np.hanning(len(residual) + 1)[:-1]
    lines = np.fft.rfft(residual * taper[:, None], axis=0)
    frequency = np.asarray(np.fft.rfftfreq(len(residual), comparison.time_step), dtype=np.float64)
    harmonic = np.arange(len(frequency))
    sides = np.where((harmonic > 0) & (2 * harmonic < len(residual)), 2.0, 1.0)
    amplitude = sides[:, None] * np.abs(lines) / taper.sum()
    return Spectrum(comparison.name, frequency, amplitude)
