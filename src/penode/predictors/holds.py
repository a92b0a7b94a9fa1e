"""Holds: how an input known at samples acts between them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from penode.arrays import JaxArray

#: Gives the input (input, batch) at sample k + offset, gathered only when asked for.
Drive = Callable[[int], JaxArray]


class Hold(Protocol):
    """The input at a time between two samples."""

    def __call__(self, drive: Drive, sample: int, share: float, time_step: float) -> JaxArray:
        """Return the input (input, batch) at sample k + `sample`, plus `share` of the interval.

        Parameters
        ----------
        drive : callable
            Input by offset from sample k.
        sample : int
            Offset of the interval's first sample.
        share : float
            0 at the interval's start, 1 at its end (still within it).
        time_step : float
            Length of the interval in s.
        """
        ...


@dataclass(frozen=True)
class ZeroOrder:
    """Constant from each sample to the next."""

    def __call__(self, drive: Drive, sample: int, share: float, time_step: float) -> JaxArray:
        """Return the input at the interval's start."""
        return drive(sample)


@dataclass(frozen=True)
class FirstOrder:
    """Straight from each sample to the next."""

    def __call__(self, drive: Drive, sample: int, share: float, time_step: float) -> JaxArray:
        """Return the input on the line between the interval's ends."""
        if share == 0.0:
            return drive(sample)
        return (1.0 - share) * drive(sample) + share * drive(sample + 1)
