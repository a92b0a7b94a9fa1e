"""Butcher tableaus: explicit Runge-Kutta methods as checked data.

To add a method, add one table here; `penode.predictors.one_step` runs them all.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ButcherTableau:
    """Coefficients of an explicit Runge-Kutta method.

    Attributes
    ----------
    name : str
    order : int
        Order of convergence.
    a : tuple of tuples of float
        Row s holds the s weights of the earlier slopes in stage s + 1 (the first stage has none).
    b : tuple of float
        Weights of the slopes in the step.

    Raises
    ------
    ValueError
        If the table is not explicit or its weights do not add up to 1.
    """

    name: str
    order: int
    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]

    def __post_init__(self) -> None:
        lengths = [len(row) for row in self.a]
        if lengths != list(range(1, len(self.b))):
            raise ValueError(f"{self.name}: rows of a have lengths {lengths}; want 1, 2, ...")
        if not np.isclose(sum(self.b), 1.0, rtol=0, atol=1e-14):
            raise ValueError(f"{self.name}: weights b add up to {sum(self.b)}; want 1.")

    @property
    def nodes(self) -> tuple[float, ...]:
        """Times of the stages as shares of the step (row sums of a)."""
        return (0.0, *(sum(row) for row in self.a))


EULER = ButcherTableau("euler", 1, (), (1.0,))

#: Classic fourth-order method (Butcher 2008, eq. 235i); the paper's solver.
RK4 = ButcherTableau(
    "rk4", 4, ((1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6)
)
