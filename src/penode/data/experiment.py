"""Experiment: one uniformly sampled recording in SI units, with where it came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.data.gathered import mapping_of, released
from penode.errors import InputError


@dataclass(frozen=True)
class Source:
    """Where a recording came from.

    Attributes
    ----------
    path : str
        File as the user named it, or a description such as ``"simulated"``.
    sha256 : str
        Digest of the file's bytes (of the channel data where there was no file).
    """

    path: str
    sha256: str


@dataclass(frozen=True, eq=False)
class Experiment:
    """One uniformly sampled recording.

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

    Raises
    ------
    InputError
        If the channels differ in length.
    """

    name: str
    time_step: float
    channels: Mapping[str, FloatArray]
    source: Source = field(default=Source("memory", ""))

    def __post_init__(self) -> None:
        frozen = {}
        for name, values in self.channels.items():
            frozen[name] = _frozen(values)
        lengths = {name: len(values) for name, values in frozen.items()}
        if len(set(lengths.values())) > 1:
            raise InputError(
                f"{self.name}: channels differ in length ({lengths}); give one length."
            )
        object.__setattr__(self, "channels", MappingProxyType(frozen))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the channels as a plain dict: their read-only view cannot be pickled."""
        return Experiment, (self.name, self.time_step, dict(self.channels), self.source)

    def __len__(self) -> int:
        return len(next(iter(self.channels.values()), ()))

    def part(self, first: int, last: int) -> "Experiment":
        """Return the samples ``first .. last - 1`` as a recording that names its data rows.

        Parameters
        ----------
        first, last : int
        """
        channels = {}
        for name, values in self.channels.items():
            channels[name] = values[first:last].copy()
            released(values)
        name = f"{self.name} rows {first + 1} to {last}"
        return replace(self, name=name, channels=channels)

    def require(self, names: Sequence[str]) -> None:
        """Refuse a recording that lacks a channel.

        Parameters
        ----------
        names : sequence of str
            Channels.

        Raises
        ------
        InputError
            If a channel is missing; the message names the file, the missing and the present ones.
        """
        missing = [name for name in names if name not in self.channels]
        if missing:
            raise InputError(
                f"{self.name}: no channel {', '.join(missing)}; it has "
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
        columns = [self.channels[name] for name in names]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self), 0))


def _frozen(values: FloatArray) -> FloatArray:
    """Return values that cannot be written to, copied where they could."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        own = values.flags.owndata or mapping_of(values) is not None
        if own and not values.flags.writeable:
            return values
    copy = np.array(values, dtype=np.float64)
    copy.setflags(write=False)
    return copy
