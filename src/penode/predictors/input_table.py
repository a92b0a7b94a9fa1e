"""Inputs between samples, tabulated once a recording: what a solver reads of each sub-step."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as entry
from typing import Any

import jax
import jax.numpy as jnp

from penode.arrays import FloatArray, JaxArray
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.inputs import Inputs
from penode.predictors.field import Field, Part, moved_on
from penode.predictors.holds import RecordedHold, ZeroOrderHold
from penode.predictors.one_step import Substeps
from penode.predictors.places import places_of
from penode.predictors.solver import Solver


@dataclass(frozen=True)
class InputTable:
    """What a one-step solver reads of a recording's inputs in each of its sub-steps.

    Compiled code looks rows up, and is told at run time how many sub-steps there are: one program
    serves every hold and every number of them.
    """

    solver: Solver
    # Fractions of a sub-step that the solver reads, the sub-step's begin first.
    places: tuple[float, ...]
    # Sub-steps a sample.
    count: int
    hold: RecordedHold

    @classmethod
    def of(cls, solver: Solver, hold: RecordedHold) -> "InputTable":
        """Return the table of a one-step solver, which may be sub-steps of another."""
        one = solver.solver if isinstance(solver, Substeps) else solver
        count = solver.count if isinstance(solver, Substeps) else 1
        places = tuple(sorted({0.0, *places_of(one)}))
        return cls(one, places, count, hold)

    def rows(self, inputs: FloatArray) -> FloatArray:
        """Return a recording's inputs (time, input) as (time, sub-step * place * input)."""
        steps = range(self.count)
        fractions = [(number + place) / self.count for number in steps for place in self.places]
        return self.hold.between(inputs, fractions).reshape(len(inputs), -1)

    def step(self, model: Model, history: JaxArray, rows: JaxArray, time_step: float) -> JaxArray:
        """Return the next sample in front: (1, state, batch), from its rows (row, batch)."""
        rows = rows.reshape(self.count, -1, rows.shape[-1])
        start = rows[0, : len(driving_channels(model))]

        def one(history: JaxArray, step: tuple[JaxArray, JaxArray]) -> tuple[JaxArray, None]:
            number, own = step
            part = Substep(number, self.count, start, time_step)
            return self.substep(model, history, own, part), None

        ahead: JaxArray = jax.lax.scan(one, history, (jnp.arange(self.count), rows))[0]
        return ahead

    def substep(self, model: Model, history: JaxArray, rows: JaxArray, part: "Substep") -> JaxArray:
        """Return the state (1, state, batch) after a sub-step from its rows (row, batch)."""
        blocks = rows.reshape(len(self.places), -1, rows.shape[-1])
        read = {
            place: part.moved_on(Inputs(block, driving_channels(model)), model, place)
            for place, block in zip(self.places, blocks, strict=True)
        }
        return self.solver.advance(_Tabulated.of(model, read, part.width), history)[None]


@dataclass(frozen=True)
class Substep:
    """Which sub-step of a sample."""

    # The sub-step, from 0, and how many there are.
    number: int | JaxArray
    count: int | JaxArray
    # Inputs (input, batch) at the sample.
    start: JaxArray
    # Sampling interval in s.
    time_step: float

    @property
    def width(self) -> Any:
        """Length of the sub-step in s."""
        return self.time_step / self.count

    def moved_on(self, u: Inputs, model: Model, place: float) -> Inputs:
        """Return inputs at a place of the sub-step, those with a rate as they are by then."""
        elapsed = (self.number + place) * self.width
        return moved_on(u, Inputs(self.start, u.names), elapsed, model)


@dataclass(frozen=True)
class _Tabulated(Field):
    """A field over a sub-step whose inputs are known at the places where they are read."""

    read: Mapping[float, Inputs] = entry(default_factory=dict)

    @classmethod
    def of(cls, model: Model, read: Mapping[float, Inputs], width: Any) -> "_Tabulated":
        values = read[0.0].values
        return cls(model, lambda offset: values, ZeroOrderHold(), width, read=read)

    def input(self, sample: int, fraction: float) -> Inputs:
        """Return the input at a place within the sub-step."""
        return self.read[fraction]

    def _over(self, u: Inputs, part: Part | None, fraction: float) -> Inputs:
        """Return the input for the part of the sub-step that it represents."""
        if part is None:
            return u.over(None)
        begin, end = (at - fraction for at in part)
        return u.over((begin, end), self.width)
