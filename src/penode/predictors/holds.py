"""Holds: how an input known at samples acts between them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import jax
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.models.inputs import Inputs

#: Gives the input (input, batch) at sample k + offset, gathered only when asked for. Offsets may
#: differ over the batch.
Drive = Callable[[int | JaxArray], JaxArray]


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


@runtime_checkable
class RecordedHold(Protocol):
    """A hold whose inputs between samples a recording determines, whatever the model is."""

    def between(self, inputs: FloatArray, fractions: Sequence[float]) -> FloatArray:
        """Return a recording's inputs at fractions of each interval.

        Parameters
        ----------
        inputs : ndarray, shape (time, input)
        fractions : sequence of float
            0 at an interval's start, 1 at its end (still within it).

        Returns
        -------
        ndarray, shape (time, fraction, input)
            The interval after the last sample has that sample throughout.
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

    def between(self, inputs: FloatArray, fractions: Sequence[float]) -> FloatArray:
        """Return a recording's inputs at fractions of each interval; see `RecordedHold`."""
        return np.repeat(inputs[:, None], len(fractions), axis=1)


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

    def between(self, inputs: FloatArray, fractions: Sequence[float]) -> FloatArray:
        """Return a recording's inputs at fractions of each interval; see `RecordedHold`."""
        ahead = np.concatenate([inputs[1:], inputs[-1:]])
        along = np.asarray(fractions)[:, None]
        return np.asarray((1.0 - along) * inputs[:, None] + along * ahead[:, None])
