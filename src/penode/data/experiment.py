"""Experiment: one uniformly sampled recording in SI units, with where it came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from penode.arrays import FloatArray
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
        Channel values in SI units; copied and made read-only at construction.
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
            copy = np.array(values, dtype=np.float64)
            copy.setflags(write=False)
            frozen[name] = copy
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
        missing = [name for name in names if name not in self.channels]
        if missing:
            raise InputError(
                f"{self.name}: no channel {', '.join(missing)}; it has "
                f"{', '.join(self.channels) or 'none'}; add or rename the column."
            )
        columns = [self.channels[name] for name in names]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self), 0))
