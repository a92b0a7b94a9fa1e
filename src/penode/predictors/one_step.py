"""One-step solvers: explicit Runge-Kutta tables, and sub-steps of any of them."""

from dataclasses import dataclass

from penode.arrays import JaxArray
from penode.predictors.field import Field
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

    def __str__(self) -> str:
        return self.table.name

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
            raise ValueError(f"sub-steps must be >= 1, got {self.count}.")

    def __str__(self) -> str:
        return f"{self.solver}, {self.count} steps a sample"

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
        for number in range(self.count):
            history = self.solver.advance(field.split(number, self.count), history)[None]
        return history[0]
