"""LearnedMap: what every learned map offers, whatever is inside."""

from collections.abc import Iterable
from typing import Protocol

from penode.arrays import JaxArray


class LearnedMap(Protocol):
    """A map from n inputs to m outputs, an `equinox.Module` of trained and static fields."""

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, n, batch) at x (n, batch)."""


def floats(values: Iterable[float]) -> tuple[float, ...]:
    """Return plain numbers as a tuple: static fields are compared and hashed."""
    return tuple(float(value) for value in values)
