"""Where in an interval a solver reads the input."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.models.base import Model
from penode.models.inputs import Inputs
from penode.predictors.field import Field
from penode.predictors.solver import Solver


class _Still(Model):
    """A state at rest."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("",)

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return zeros."""
        return 0.0 * x


@dataclass(frozen=True)
class _Asked:
    """A hold that writes down what it is asked for."""

    fractions: set[float]

    def __call__(
        self, drive: Callable[[int], Inputs], sample: int, fraction: float, time_step: float
    ) -> Inputs:
        """Return the input at the interval's start."""
        self.fractions.add(fraction)
        return drive(sample)


@lru_cache(maxsize=64)
def places_of(solver: Solver) -> tuple[float, ...]:
    """Return the fractions of an interval at which a solver reads the input, ascending.

    The solver is followed through one step of a model at rest.
    """
    asked, at_rest = _Asked(set()), jnp.asarray(np.zeros((1, 1)))
    field = Field(_Still(), lambda offset: at_rest, asked, 1.0)
    jax.eval_shape(lambda x: solver.advance(field, x), np.zeros((solver.past, 1, 1)))
    return tuple(sorted(asked.fractions))
