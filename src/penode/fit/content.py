"""What of a fit is shown as text, table or figure."""

from collections.abc import Mapping
from typing import Protocol

from penode.arrays import BoolArray, FloatArray
from penode.fit.outcome import Estimate, HorizonChoice
from penode.models.base import Model
from penode.validation.comparison import Comparison


class FitContent(Protocol):
    """The part of a `penode.Fit` that a summary or a figure reads; see there for its fields."""

    @property
    def model(self) -> Model:
        """The model."""
        ...

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """Physical parameters by name."""
        ...

    @property
    def horizon(self) -> HorizonChoice:
        """The horizon and its ladder."""
        ...

    @property
    def excited(self) -> FloatArray:
        """Visited states, shape (sample, state)."""
        ...

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Recordings, or stretches of them, beside their predictions."""
        ...

    @property
    def recordings(self) -> tuple[Comparison, ...]:
        """The same, the stretches of a recording as one."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences."""
        ...

    def supported(self, points: FloatArray) -> BoolArray:
        """Return which points (point, state) lie in the excited region, shape (point,)."""
        ...
