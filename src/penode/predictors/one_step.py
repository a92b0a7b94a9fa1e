"""One-step solvers: explicit Runge-Kutta tables, and sub-steps of any of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as entry

import jax
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.models.inputs import Inputs
from penode.predictors.field import Field
from penode.predictors.places import places_of
from penode.predictors.solver import Solver
from penode.predictors.tableaus import ButcherTableau


@dataclass(frozen=True)
class RungeKutta:
    """An explicit Runge-Kutta method, one step a sample.

    Attributes
    ----------
    table : ButcherTableau
    """

    table: ButcherTableau

    @property
    def order(self) -> int:
        """Order of convergence."""
        return self.table.order

    @property
    def past(self) -> int:
        """Measured samples a prediction starts from."""
        return 1

    def advance(self, field: Field, history: JaxArray) -> JaxArray:
        """Return the next state (state, batch) from history (1, state, batch)."""
        x, table = history[0], self.table
        slopes = [field(x, part=table.parts[0])]
        for row, node, part in zip(table.a, table.nodes[1:], table.parts[1:], strict=True):
            at = x + field.width * weighted(row, slopes)
            slopes.append(field(at, fraction=node, part=part))
        return x + field.width * weighted(self.table.b, slopes)


def weighted(weights: tuple[float, ...], slopes: list[JaxArray]) -> JaxArray:
    """Return the weighted sum of slopes, leaving out those of weight zero."""
    terms = [w * k for w, k in zip(weights, slopes, strict=True) if w != 0.0]
    return sum(terms[1:], terms[0])


@dataclass(frozen=True)
class Substeps:
    """Several equal steps of a one-step solver in each sample.

    Attributes
    ----------
    solver : Solver
        With `past` = 1.
    count : int
        Steps a sample.

    Raises
    ------
    ValueError
        If the solver needs more than one past sample, or count is below 1.
    """

    solver: Solver
    count: int

    def __post_init__(self) -> None:
        if self.solver.past != 1:
            raise ValueError(f"{self.solver} uses past samples; sub-steps need a one-step solver.")
        if self.count < 1:
            raise ValueError(f"{self.count} sub-steps came; want at least 1.")

    @property
    def order(self) -> int:
        """Order of convergence."""
        return self.solver.order

    @property
    def past(self) -> int:
        """Measured samples a prediction starts from."""
        return 1

    def advance(self, field: Field, history: JaxArray) -> JaxArray:
        """Return the next state (state, batch) from history (1, state, batch)."""
        steps = [field.split(number, self.count) for number in range(self.count)]
        read = {
            place: _stacked([step.input(0, place) for step in steps])
            for place in places_of(self.solver)
        }

        def advance(history: JaxArray, inputs: Mapping[float, Inputs]) -> tuple[JaxArray, None]:
            return self.solver.advance(_Substep.of(steps[0], inputs), history)[None], None

        last: JaxArray = jax.lax.scan(advance, history, read)[0]
        return last[0]


def _stacked(inputs: list[Inputs]) -> Inputs:
    stacked: Inputs = jax.tree.map(lambda *rows: jnp.stack(rows), *inputs)
    return stacked


@dataclass(frozen=True)
class _Substep(Field):
    """A field whose input is known where it is read: one program serves all sub-steps.

    Attributes
    ----------
    inputs : mapping of float to Inputs
        By the place within the sub-step.
    """

    inputs: Mapping[float, Inputs] = entry(default_factory=dict)

    @classmethod
    def of(cls, step: Field, inputs: Mapping[float, Inputs]) -> "_Substep":
        """Return a sub-step as long as another, with inputs of its own."""
        return cls(step.model, step.drive, step.hold, step.width, inputs=inputs)

    def input(self, sample: int, fraction: float) -> Inputs:
        """Return the input at a place within the sub-step."""
        return self.inputs[self.first + self.length * fraction]
