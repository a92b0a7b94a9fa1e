"""A hold for inputs that were sampled fast enough: the one band-limited signal through them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.models.inputs import Inputs

#: Samples to each side of a place that its value is made of, and the window's shape: errors below
#: 1e-10 up to 0.88 of the Nyquist frequency (Kaiser's formulas for a ripple of 226 dB).
_SIDE, _SHAPE = 64, 24.0
#: Samples from which those beyond an end are foretold, windows of them that show how, and singular
#: values over the largest below which they show nothing.
_ORDER, _ROWS, _RANK = 128, 2000, 1e-11
#: Places in an interval that differ by less are one.
_DIGITS = 12


@dataclass(frozen=True)
class BandLimitedHold:
    """The signal without content above the Nyquist frequency that goes through the samples.

    Exact to 1e-10 for inputs whose content lies below 0.88 of the Nyquist frequency, such as a
    multisine or what an anti-aliasing filter lets pass; not for inputs that jump. Values between
    the samples are computed once a recording (`penode.Predictor.prepared`), at the places that the
    solver asks for, by a sinc in a Kaiser window 128 samples long; compiled code looks them up.

    Within 64 samples of an end the recording goes on as linear prediction from 128 samples says: as
    exact for a multisine of up to 40 lines, to 1e-6 for any content below 0.3 of the Nyquist
    frequency. A recording of fewer than 256 samples is reflected about its end points instead, to
    1e-3. Stretches of a recording have ends of their own.

    References
    ----------
    J. F. Kaiser and R. W. Schafer, On the use of the I0-sinh window for spectrum analysis, IEEE
    Trans. ASSP 28 (1980) 105, doi:10.1109/TASSP.1980.1163349.
    """

    def __call__(
        self, drive: Callable[[int], Inputs], sample: int, fraction: float, time_step: float
    ) -> Inputs:
        """Return the input at a sample.

        Raises
        ------
        InputError
            Between samples, where the whole recording is needed: `penode.Predictor` reads it there.
        """
        if fraction != 0.0:
            raise InputError(
                f"a band-limited input at {fraction:.3g} of an interval depends on the whole "
                "recording; predict by a Predictor, which interpolates it once."
            )
        return drive(sample)

    def between(self, inputs: FloatArray, fractions: Sequence[float]) -> FloatArray:
        """Return a recording's inputs at fractions of each interval; see `RecordedHold`."""
        inputs = np.ascontiguousarray(inputs, dtype=np.float64)
        places = tuple(round(fraction, _DIGITS) for fraction in fractions)
        if not inputs.size or not places:
            return np.empty((len(inputs), len(places), inputs.shape[1]))
        return _interpolated(inputs.tobytes(), inputs.shape, places)


# A ladder cuts the same recordings once a horizon.
@lru_cache(maxsize=16)
def _interpolated(samples: bytes, shape: tuple[int, ...], places: tuple[float, ...]) -> FloatArray:
    from scipy.signal import oaconvolve  # a quarter of start-up, which most holds do without

    inputs = np.frombuffer(samples).reshape(shape)
    ahead = np.concatenate([inputs[1:], inputs[-1:]])
    known = {0.0: inputs, 1.0: ahead}
    longer = extended(inputs) if set(places) - set(known) else inputs
    taps = np.arange(1 - _SIDE, _SIDE + 1)
    for place in set(places) - set(known):
        away = place - taps
        weights = np.sinc(away) * np.i0(_SHAPE * np.sqrt(1 - (away / _SIDE) ** 2))
        weights /= weights.sum()
        # The filter runs backwards, and its last value lies beyond the end.
        known[place] = oaconvolve(longer, weights[::-1, None], mode="valid", axes=0)[1:]
    whole = np.stack([known[place] for place in places], axis=1)
    whole.setflags(write=False)
    return whole


def extended(inputs: FloatArray) -> FloatArray:
    """Return inputs (time, input) with 64 more samples at each end."""
    if len(inputs) < 2 * _ORDER:
        return np.pad(inputs, [(_SIDE, _SIDE), (0, 0)], mode="reflect", reflect_type="odd")
    columns = [np.concatenate([_beyond(c[::-1])[::-1], c, _beyond(c)]) for c in inputs.T]
    return np.stack(columns, axis=1)


def _beyond(column: FloatArray) -> FloatArray:
    """Return the samples (64,) after a column's end, foretold from its last ones."""
    middle = column.mean()
    centred = column - middle
    order = min(_ORDER, (len(column) - _SIDE) // 2)
    seen = np.lib.stride_tricks.sliding_window_view(centred, order + _SIDE)[-_ROWS:]
    weights = np.linalg.lstsq(seen[:, :order], seen[:, order:], rcond=_RANK)[0]
    return np.asarray(middle + centred[-order:] @ weights)
