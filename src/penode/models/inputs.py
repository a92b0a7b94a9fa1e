"""Inputs: the rows of a model's input by name, at one moment or over a part of a sample."""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.errors import InputError


class Inputs(eqx.Module):
    """The input u of a model: ``u["omega_el"]``, or ``u[2]`` in the order of `Model.inputs`.

    The values (input, batch) are in SI units, a row for each of the names. They represent a part of
    the sample: its ``span`` from beginning to end, in units of so many s after the moment they
    belong to; (0, 0) is the moment alone, None where a solver's stages represent no part.
    """

    values: JaxArray
    names: tuple[str, ...] = eqx.field(static=True)
    span: tuple[float, float] | None = eqx.field(static=True, default=(0.0, 0.0))
    unit: float | JaxArray = 1.0

    def __getitem__(self, which: str | int | tuple[str, ...]) -> JaxArray:
        """Return one row (batch,), or the rows (row, batch) of several names."""
        if isinstance(which, str):
            return self.values[self._place(which)]
        if isinstance(which, tuple):
            places = [self._place(name) for name in which]
            first = places[0]
            if places == list(range(first, first + len(places))):
                return self.values[first : first + len(places)]
            return self.values[np.array(places)]
        if isinstance(which, int):
            if not -len(self.names) <= which < len(self.names):
                raise IndexError(f"no input {which}; the model's inputs are {self._listed}")
            return self.values[which]
        raise TypeError(f"an input is taken by its name or place, got u[{which!r}].")

    def __iter__(self) -> Iterator[JaxArray]:
        """Iterate over the rows, so that ``u_d, u_q, speed = u`` works."""
        return (self.values[k] for k in range(len(self.names)))

    def replaced(self, **rows: JaxArray) -> "Inputs":
        """Return the inputs with some rows (batch,) exchanged."""
        kept = [rows.get(name, self.values[k]) for k, name in enumerate(self.names)]
        return Inputs(jnp.stack(kept), self.names, self.span, self.unit)

    def leading(self, names: tuple[str, ...]) -> "Inputs":
        """Return the first rows, which are those of these names."""
        return Inputs(self.values[: len(names)], names, self.span, self.unit)

    def over(self, span: tuple[float, float] | None, unit: float | JaxArray = 1.0) -> "Inputs":
        """Return the same values for another part of the sample; see `span`."""
        return Inputs(self.values, self.names, span, unit)

    def part_for(self, purpose: str) -> tuple[Any, Any]:
        """Return the middle of the part of the sample and half its length, in s.

        Refuses stages of a solver that represent no part; ``purpose`` says what needs it.
        """
        if self.span is None:
            raise InputError(
                f"{purpose} takes its mean over the part of a sample that a stage of the solver "
                "represents, and the stages of this solver represent none; choose a Runge-Kutta "
                "method without negative weights, such as RK4, or an implicit method."
            )
        begin, end = self.span
        if begin == end == 0.0:
            return 0.0, 0.0
        return 0.5 * (begin + end) * self.unit, 0.5 * (end - begin) * self.unit

    def _place(self, name: str) -> int:
        try:
            return self.names.index(name)
        except ValueError:
            raise KeyError(f"no input {name!r}; the model's inputs are {self._listed}") from None

    @property
    def _listed(self) -> str:
        return ", ".join(self.names) or "none"
