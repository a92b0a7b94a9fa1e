"""Holds: how an input known at samples acts between them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import jax

from penode.arrays import JaxArray
from penode.models.inputs import Inputs

#: Gives the input (input, batch) at sample k + offset, gathered only when asked for.
Drive = Callable[[int], JaxArray]


class Hold(Protocol):
    """The input at a time between two samples.

    Inputs with a rate of their own (`penode.Model.input_rates`) go on whatever a hold says.
    """

    def __call__(
        self, drive: Callable[[int], Inputs], sample: int, fraction: float, time_step: float
    ) -> Inputs:
        """Return the input at sample k + `sample`, plus a fraction of the interval.

        Parameters
        ----------
        drive : callable
            Input by offset from sample k, its rows of shape (batch,).
        sample : int
            Offset of the interval's first sample.
        fraction : float
            0 at the interval's start, 1 at its end (still within it).
        time_step : float
            Length of the interval in s.
        """
        ...


@dataclass(frozen=True)
class ZeroOrderHold:
    """Constant from each sample to the next."""

    def __call__(
        self, drive: Callable[[int], Inputs], sample: int, fraction: float, time_step: float
    ) -> Inputs:
        """Return the input at the interval's start."""
        return drive(sample)


@dataclass(frozen=True)
class FirstOrderHold:
    """Straight from each sample to the next."""

    def __call__(
        self, drive: Callable[[int], Inputs], sample: int, fraction: float, time_step: float
    ) -> Inputs:
        """Return the input on the line between the interval's ends."""
        if fraction == 0.0:
            return drive(sample)
        between: Inputs = jax.tree.map(
            lambda begin, end: (1.0 - fraction) * begin + fraction * end,
            drive(sample),
            drive(sample + 1),
        )
        return between
