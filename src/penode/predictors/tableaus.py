"""Coefficients of explicit methods as checked data: Butcher tableaus and Adams-Bashforth weights.

To add a method, add one table here; `penode.predictors.one_step` and `multistep` run them all.
"""

import itertools
from dataclasses import dataclass
from fractions import Fraction

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
            raise ValueError(f"{self.name}: rows of a must have lengths 1, 2, ..., got {lengths}.")
        if not np.isclose(sum(self.b), 1.0, rtol=0, atol=1e-14):
            raise ValueError(f"{self.name}: weights b must add up to 1, got {sum(self.b)}.")

    @property
    def nodes(self) -> tuple[float, ...]:
        """Times of the stages as fractions of the step (row sums of a)."""
        return (0.0, *(sum(row) for row in self.a))

    @property
    def parts(self) -> tuple[tuple[float, float] | None, ...]:
        """Part of the step that each stage represents, as its beginning and end.

        Stages follow each other in the order of their nodes, each as long as its weight; those of
        one node share one part. Together they cover the step once, so that a quantity that jumps
        within it is weighed by how long it holds. A stage without weight represents its moment; so
        does that of Euler's method, of which the part lies wholly after it. Where a weight is
        negative no stage represents any part, and all are None.
        """
        lengths: dict[float, float] = {}
        for node, weight in sorted(zip(self.nodes, self.b, strict=True)):
            lengths[node] = lengths.get(node, 0.0) + weight
        if min(lengths.values()) < 0:
            return (None,) * len(self.b)
        if self.order == 1:
            return tuple((node, node) for node in self.nodes)
        ends = dict(zip(lengths, itertools.accumulate(lengths.values()), strict=True))
        part = {n: (ends[n] - lengths[n], ends[n]) if lengths[n] else (n, n) for n in lengths}
        return tuple(part[node] for node in self.nodes)


@dataclass(frozen=True)
class AdamsBashforthTable:
    """Weights of the slopes at the present and the past samples, newest first.

    Attributes
    ----------
    name : str
    b : tuple of float
        As many weights as the order.

    Raises
    ------
    ValueError
        If the weights do not integrate polynomials of every degree below the order exactly.
    """

    name: str
    b: tuple[float, ...]

    def __post_init__(self) -> None:
        for degree in range(self.order):
            moment = sum(w * (-j) ** degree for j, w in enumerate(self.b))
            if not np.isclose(moment, 1 / (degree + 1), rtol=0, atol=1e-12):
                raise ValueError(
                    f"{self.name}: moment {degree} must be {1 / (degree + 1)}, got {moment}."
                )

    @property
    def order(self) -> int:
        """Order of convergence."""
        return len(self.b)


EULER = ButcherTableau("euler", 1, (), (1.0,))
MIDPOINT = ButcherTableau("midpoint", 2, ((1 / 2,),), (0.0, 1.0))
HEUN = ButcherTableau("heun", 2, ((1.0,),), (1 / 2, 1 / 2))
#: Least error bound among two-stage methods (Ralston 1962, doi:10.1090/S0025-5718-1962-0150954-0).
RALSTON = ButcherTableau("ralston", 2, ((2 / 3,),), (1 / 4, 3 / 4))
#: Kutta's third-order method (Butcher 2008, section 233).
RK3 = ButcherTableau("rk3", 3, ((1 / 2,), (-1.0, 2.0)), (1 / 6, 2 / 3, 1 / 6))
#: Classic fourth-order method (Butcher 2008, eq. 235i); the paper's solver.
RK4 = ButcherTableau(
    "rk4", 4, ((1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6)
)
#: Kutta's 3/8 rule, which some libraries call rk4.
RK4_38 = ButcherTableau(
    "rk4_38", 4, ((1 / 3,), (-1 / 3, 1.0), (1.0, -1.0, 1.0)), (1 / 8, 3 / 8, 3 / 8, 1 / 8)
)
#: The fifth-order member of the pair of Dormand and Prince (1980),
#: doi:10.1016/0771-050X(80)90013-3, at a fixed step.
DOPRI5 = ButcherTableau(
    "dopri5",
    5,
    (
        (1 / 5,),
        (3 / 40, 9 / 40),
        (44 / 45, -56 / 15, 32 / 9),
        (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
        (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    ),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)

RUNGE_KUTTA = (EULER, MIDPOINT, HEUN, RALSTON, RK3, RK4, RK4_38, DOPRI5)


def _weights(*numerators: int, over: int) -> tuple[float, ...]:
    return tuple(float(Fraction(n, over)) for n in numerators)


#: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, section III.1.
AB2 = AdamsBashforthTable("ab2", _weights(3, -1, over=2))
AB3 = AdamsBashforthTable("ab3", _weights(23, -16, 5, over=12))
AB4 = AdamsBashforthTable("ab4", _weights(55, -59, 37, -9, over=24))
AB5 = AdamsBashforthTable("ab5", _weights(1901, -2774, 2616, -1274, 251, over=720))

ADAMS_BASHFORTH = (AB2, AB3, AB4, AB5)
