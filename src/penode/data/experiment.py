"""Experiment: one uniformly sampled recording in SI units, with where it came from."""

import math
import numbers
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from penode.arrays import CLOCK, FloatArray
from penode.data.gathered import mapping_of, released
from penode.data.time_axis import MINIMUM_SAMPLES, uniform_stretches
from penode.errors import InputError, did_you_mean

#: Kind of numbers -> what is wrong with them, and the fix.
_KINDS = {
    "b": "is boolean; give numbers, as in values.astype(float)",
    "c": "is complex; give real numbers, as in values.real",
    "U": "is text; give numbers, as in values.astype(float)",
    "S": "is text; give numbers, as in values.astype(float)",
    "M": "holds dates; give numbers, and the interval between samples as time_step",
    "m": "holds times; give numbers, as in values / np.timedelta64(1, 's')",
}
_MIXED = "give one real number a sample, as an array of floats"


@dataclass(frozen=True)
class Source:
    """Where a recording came from: a file, or words such as ``"simulated"``, and its digest.

    The digest is that of the file's bytes, or of the channel data where there was no file.
    """

    path: str
    sha256: str


@dataclass(frozen=True)
class Stretch:
    """Where an experiment lies within a longer recording; start and duration of that one, in s.

    ``row`` is how many data rows of the recording come before; ``start`` counts from its first
    sample, ``duration`` to its last; ``reasons`` say why it was cut, and what was left out, a
    sentence each.
    """

    recording: str
    row: int
    start: float
    duration: float
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Experiment:
    """One uniformly sampled recording, or a stretch of one.

    Attributes
    ----------
    name : str
        Label used in messages, tables and the report (the file's name).
    time_step : float
        Sampling interval in s.
    channels : mapping of str to ndarray, each of shape (time,)
        Channel values in SI units; copied and made read-only at construction, but for those that
        nobody can write to: mapped from a file, or of another recording.
    source : Source
        Provenance.
    stretch : Stretch or None
        Where it lies within a longer recording; None where it is a whole one.

    Raises
    ------
    InputError
        If the name is no text, the time step is no number above 0, or the channels are no series
        of real numbers of one length.
    """

    name: str
    time_step: float
    channels: Mapping[str, FloatArray]
    source: Source = field(default=Source("memory", ""))
    stretch: Stretch | None = None

    def __post_init__(self) -> None:
        _require_form(self.name, self.time_step, self.channels)
        frozen = {name: _frozen(values) for name, values in self.channels.items()}
        lengths = {name: len(values) for name, values in frozen.items()}
        if len(set(lengths.values())) > 1:
            raise InputError(f"{self.name}: channels must have one length, got {lengths}.")
        object.__setattr__(self, "channels", MappingProxyType(frozen))

    def __repr__(self) -> str:
        return (
            f"Experiment {self.name}: {len(self)} samples of {self.time_step:.6g} s, channels "
            f"{', '.join(self.channels)}"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the channels as a plain dict: their read-only view cannot be pickled."""
        channels = dict(self.channels)
        return Experiment, (self.name, self.time_step, channels, self.source, self.stretch)

    def __len__(self) -> int:
        return len(next(iter(self.channels.values()), ()))

    @property
    def place(self) -> Stretch:
        """Where it lies within its recording, which may be itself."""
        duration = max(len(self) - 1, 0) * self.time_step
        return self.stretch or Stretch(self.name, 0, 0.0, duration)

    @classmethod
    def from_times(
        cls, name: str, times: FloatArray, channels: Mapping[str, FloatArray]
    ) -> tuple["Experiment", ...]:
        """Return a recording by the times of its samples: the stretches between gaps in them.

        Nothing is predicted across a gap, and each stretch keeps its times.

        Parameters
        ----------
        name : str
        times : ndarray, shape (time,)
            In s, uniform to 1 % between the gaps; these are steps above 1.5 of the median step.
        channels : mapping of str to ndarray, each of shape (time,)
            Channel values in SI units.

        Returns
        -------
        tuple of Experiment
            In order of time; stretches of fewer than 8 samples are left out.

        Raises
        ------
        InputError
            If times repeat, decrease, jitter, or differ in step between the stretches; if they are
            not as many as samples; and as the class itself.
        """
        from penode.data.stretches import between_gaps  # which is built on this module

        t = np.asarray(times)
        if t.ndim != 1 or t.dtype.kind not in "iuf" or not np.isfinite(t).all():
            raise InputError(f"{name}: times must be numbers, one a sample; give them in s.")
        t = t.astype(np.float64)
        step, spans = uniform_stretches(name, t, MINIMUM_SAMPLES)
        whole = cls(name, step, channels)
        if len(whole) != len(t):
            raise InputError(
                f"{name}: times must be as many as samples, got {len(t)} times and {len(whole)} "
                "samples; give one time a sample."
            )
        begun = Stretch(name, 0, float(t[0]), float(np.ptp(t))) if t[0] != 0.0 else None
        return between_gaps(replace(whole, stretch=begun), t, spans, MINIMUM_SAMPLES)

    @property
    def times(self) -> FloatArray:
        """Times of the samples in s, shape (time,).

        Counted from the first sample of the recording, or as `from_times` was given them.
        """
        return np.asarray(self.place.start + self.time_step * np.arange(len(self)))

    def part(self, first: int, last: int) -> "Experiment":
        """Return the samples ``first .. last - 1`` as a stretch, in memory."""
        channels = {}
        for name, values in self.channels.items():
            channels[name] = values[first:last].copy()
            released(values)
        return replace(self.between(first, last), channels=channels)

    def between(self, first: int, last: int, *reasons: str) -> "Experiment":
        """Return the samples ``first .. last - 1`` as a stretch; what lies on disk stays there.

        ``reasons`` say why the recording was cut, a sentence each.
        """
        whole = self.place
        stretch = replace(
            whole,
            row=whole.row + first,
            start=whole.start + first * self.time_step,
            reasons=(*whole.reasons, *reasons),
        )
        name = f"{whole.recording} rows {stretch.row + 1} to {stretch.row + last - first}"
        channels = {name: values[first:last] for name, values in self.channels.items()}
        return replace(self, name=name, channels=channels, stretch=stretch)

    def require(self, names: Sequence[str]) -> None:
        """Refuse a recording that lacks a channel, with an `InputError` that names it."""
        missing = [name for name in names if name not in (*self.channels, CLOCK)]
        if missing:
            raise InputError(
                f"{self.name}: no channel {', '.join(missing)}"
                f"{did_you_mean(missing[0], self.channels)}; it has "
                f"{', '.join(self.channels) or 'none'}; add or rename the column."
            )

    def stack(self, names: Sequence[str]) -> FloatArray:
        """Return the named channels side by side.

        Parameters
        ----------
        names : sequence of str
            Channels, in the order of the columns wanted.

        Returns
        -------
        ndarray, shape (time, channel)
            A new array in SI units.

        Raises
        ------
        InputError
            If a channel is missing; the message names the file, the missing and the present ones.
        """
        self.require(names)
        columns = [self.times if name == CLOCK else self.channels[name] for name in names]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self), 0))


def require_recordings(experiments: Any, validation: Any = ()) -> None:
    """Refuse what is no sequence of recordings, such as the path of one, or has none.

    ``validation`` may be empty. The message says what to type.
    """
    for name, given in (("experiments", experiments), ("validation", validation)):
        one = isinstance(given, (str, os.PathLike, Experiment)) or not isinstance(given, Sequence)
        odd = [each for each in ((given,) if one else given) if not isinstance(each, Experiment)]
        if odd and isinstance(odd[0], (str, os.PathLike)):
            path = os.fspath(odd[0])
            raise InputError(
                f"{name} must be recordings, got the path {path!r}; load each first, as in "
                f"[penode.load({path!r})]."
            )
        if odd:
            raise InputError(
                f"{name} must be a list of penode.Experiment, such as penode.load returns, got "
                f"{type(odd[0]).__name__}."
            )
        if one:
            raise InputError(
                f"{name} must be a list, got one recording, {given.name}; put it in brackets: "
                "[experiment]."
            )
    if not len(experiments):
        raise InputError("experiments must have one recording at least, as in [penode.load(path)].")


def _require_form(name: Any, time_step: Any, channels: Any) -> None:
    """Refuse what is no recording: a name, a step above 0 s, channels of real numbers (time,)."""
    if not isinstance(name, str):
        raise InputError(
            f"the name of a recording must be text, got {name!r}; write "
            'penode.Experiment("run 1", time_step, channels).'
        )
    if not (isinstance(time_step, numbers.Real) and 0 < float(time_step) < math.inf):
        got = repr(time_step) if np.ndim(time_step) == 0 else f"shape {np.shape(time_step)}"
        raise InputError(
            f"{name}: time_step must be one number above 0, got {got}; give the seconds from a "
            "sample to the next, or the time of every sample to penode.Experiment.from_times."
        )
    if not isinstance(channels, Mapping):
        raise InputError(
            f"{name}: channels is a {type(channels).__name__}; give a dictionary from names to "
            'series, as in {"position": values}.'
        )
    for channel, values in channels.items():
        if not isinstance(channel, str):
            raise InputError(
                f"{name}: the name of a channel must be text, got {channel!r}; put it in quotes."
            )
        if problem := _unusable(values):
            raise InputError(f"{name}: channel {channel} {problem}.")


def _unusable(values: Any) -> str:
    """Return why values are no series of real numbers, and the fix; nothing if they are."""
    try:
        array = values if isinstance(values, np.ndarray) else np.asarray(values)
    except (TypeError, ValueError):  # rows of different lengths
        return f"is mixed; {_MIXED}"
    if array.dtype.kind not in "iuf":
        odd = "is mixed" if array.ndim else f"holds {type(values).__name__}"
        return _KINDS.get(array.dtype.kind, f"{odd}; {_MIXED}")
    if array.ndim != 1:
        one = array.size and array.size == max(array.shape, default=0)
        fix = "as in values.ravel()" if one else "and each column a name of its own"
        return f"has shape {array.shape}; give one number a sample, shape (time,), {fix}"
    return "has masked samples; cut the recording there" if np.ma.is_masked(values) else ""


def _frozen(values: FloatArray) -> FloatArray:
    """Return values that cannot be written to, copied where they could."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        own = values.flags.owndata or mapping_of(values) is not None
        if own and not values.flags.writeable:
            return values
    copy = np.array(values, dtype=np.float64)
    copy.setflags(write=False)
    return copy
