"""Field: a model's derivative with its input filled in, as a solver sees it."""

from dataclasses import dataclass, replace
from typing import Any

from penode.arrays import JaxArray
from penode.models.base import Model
from penode.models.explicit_time import driving_channels, evaluated, rates_of
from penode.models.inputs import Inputs
from penode.predictors.holds import Drive, Hold

#: Part of a solver's step that a stage represents: its beginning and end as fractions of the step.
Part = tuple[float, float]


@dataclass(frozen=True)
class Field:
    """The derivative around sample k, over the whole interval to k + 1 or a part of it."""

    model: Model
    # Input (input, batch) by offset from sample k.
    drive: Drive
    hold: Hold
    # Sampling interval in s.
    time_step: float
    # Where the solver's step begins, and its length, as fractions of the interval.
    first: float = 0.0
    length: float = 1.0

    @property
    def width(self) -> float:
        """Length of the solver's step in s."""
        return self.time_step * self.length

    def __call__(
        self, x: JaxArray, sample: int = 0, fraction: float = 0.0, part: Part | None = None
    ) -> JaxArray:
        """Return the derivative (state, batch) of x (state, batch).

        `sample` is the interval's offset from k, `fraction` the place within the solver's step, 0
        to 1, and `part` the part of the step that this derivative represents; without it, a model
        that asks for the part is refused (`Inputs.part_for`).
        """
        u = self.input(sample, fraction)
        return evaluated(self.model, "derivative", x, self._over(u, part, fraction))

    def input(self, sample: int, fraction: float) -> Inputs:
        """Return the input at a place within the solver's step, 0 to 1, `sample` intervals on."""
        place = self.first + self.length * fraction
        u = self.hold(self._inputs, sample, place, self.time_step)
        return self._moved_on(u, sample, place)

    def split(self, number: int, count: int) -> "Field":
        """Return the field over part `number` of `count` equal parts of the step."""
        length = self.length / count
        return replace(self, first=self.first + number * length, length=length)

    def _inputs(self, offset: int) -> Inputs:
        return Inputs(self.drive(offset), driving_channels(self.model))

    def _moved_on(self, u: Inputs, sample: int, place: float) -> Inputs:
        """Return the inputs with those that have a rate moved on from the interval's start."""
        if place == 0.0 or not rates_of(self.model):
            return u
        return moved_on(u, self._inputs(sample), place * self.time_step, self.model)

    def _over(self, u: Inputs, part: Part | None, fraction: float) -> Inputs:
        """Return the input at a place within the step for the part that it represents."""
        if part is None:
            return u.over(None)
        begin, end = ((at - fraction) * self.width for at in part)
        return u.over((begin, end))


def moved_on(u: Inputs, start: Inputs, elapsed: Any, model: Model) -> Inputs:
    """Return inputs, those with a rate as they are some time, in s, after a sample's start."""
    rows = {
        name: start[name] + (start[rate] if isinstance(rate, str) else rate) * elapsed
        for name, rate in rates_of(model).items()
        if name in u.names
    }
    return u.replaced(**rows) if rows else u
