"""What is left in the one-step residual: its spectrum, and its correlations."""

from dataclasses import dataclass, field

import numpy as np

from penode.arrays import FloatArray, IntArray
from penode.data.experiment import Experiment
from penode.validation.comparison import Comparison, finite_residual


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


#: Stretches of a channel's range in which the residual is averaged, and samples each needs.
_STRETCHES, _LEAST = 40, 8
#: A channel moves whose range is more than this share of its largest value.
_MOVES = 1e-6


@dataclass(frozen=True, eq=False)
class OverChannel:
    """The one-step residual over the value of a channel.

    Attributes
    ----------
    channel : str
        Name of the channel.
    value : ndarray, shape (stretch,)
        Middles of equal stretches of its range, in its unit.
    mean, rms : ndarray, shape (stretch, state)
        Of the residual there, in the state's unit; NaN where there are few samples.
    chance : ndarray, shape (stretch,)
        Deviation of the mean over the rms of as many independent samples.
    """

    channel: str
    value: FloatArray
    mean: FloatArray
    rms: FloatArray
    chance: FloatArray = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(cls, channel: str, values: FloatArray, residual: FloatArray) -> "OverChannel":
        """Average a residual (time, state) over a channel (time,) that moves."""
        edges = np.linspace(values.min(), values.max(), _STRETCHES + 1)
        at = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _STRETCHES - 1)
        count = np.bincount(at, minlength=_STRETCHES).astype(np.float64)
        count[count < _LEAST] = np.nan
        sums, squares = (
            np.stack([np.bincount(at, each, _STRETCHES) for each in power.T], axis=-1)
            for power in (residual, residual**2)
        )
        middles = (edges[:-1] + edges[1:]) / 2
        mean, rms = sums / count[:, None], np.sqrt(squares / count[:, None])
        return cls(channel, middles, mean, rms, 1 / np.sqrt(count))


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
    over : tuple of OverChannel
        The residual over every channel that moves and is no state.
    """

    recording: str = ""
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    own: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    own_limit: float = np.inf
    cross: FloatArray = field(default_factory=lambda: np.empty((0, 0, 0)))
    cross_limit: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    over: tuple[OverChannel, ...] = ()


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
    recorded = [name for name in inputs if name in experiment.channels]  # time is no channel
    moving = tuple(name for name in recorded if np.ptp(experiment.channels[name][:-1]) > 0)
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
        over=_over_channels(comparison, experiment, predicted),
    )


def _over_channels(
    comparison: Comparison, experiment: Experiment, predicted: IntArray
) -> tuple[OverChannel, ...]:
    """Return the residual of the predicted states over each channel that moves and is no state."""
    residual = finite_residual(comparison)[:, predicted]
    others = {n: v[1:] for n, v in experiment.channels.items() if n not in comparison.states}
    found = (
        OverChannel.of(name, values, residual)
        for name, values in others.items()
        if np.isfinite(values).all() and np.ptp(values) > _MOVES * np.abs(values).max()
    )
    return tuple(one for one in found if np.isfinite(one.mean).any())


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
