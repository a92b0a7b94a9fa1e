"""Field: a model's derivative with its input filled in, as a solver sees it."""

from dataclasses import dataclass, replace

from penode.arrays import JaxArray
from penode.models.base import Model
from penode.predictors.holds import Drive, Hold


@dataclass(frozen=True)
class Field:
    """The derivative around sample k, over the whole interval to k + 1 or a part of it.

    Attributes
    ----------
    model : Model
        Parameters carry a trailing batch axis.
    drive : callable
        Input (input, batch) by offset from sample k.
    hold : Hold
        The input between samples.
    time_step : float
        Sampling interval in s.
    first, part : float
        Where the solver's step begins, and its length, as shares of the interval.
    """

    model: Model
    drive: Drive
    hold: Hold
    time_step: float
    first: float = 0.0
    part: float = 1.0

    @property
    def width(self) -> float:
        """Length of the solver's step in s."""
        return self.time_step * self.part

    def __call__(self, x: JaxArray, sample: int = 0, share: float = 0.0) -> JaxArray:
        """Return the derivative (state, batch) of x (state, batch).

        Parameters
        ----------
        x : array, shape (state, batch)
        sample : int
            Offset of the interval from k.
        share : float
            Place within the solver's step, 0 to 1.
        """
        place = self.first + self.part * share
        return self.model.derivative(x, self.hold(self.drive, sample, place, self.time_step))

    def split(self, number: int, count: int) -> "Field":
        """Return the field over part `number` of `count` equal parts of the step."""
        part = self.part / count
        return replace(self, first=self.first + number * part, part=part)
