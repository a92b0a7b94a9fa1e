"""What every solver offers; the table or the equation behind it is its own."""

from collections.abc import Hashable
from typing import Protocol

from penode.arrays import JaxArray
from penode.predictors.field import Field


class Solver(Hashable, Protocol):
    """Turns a field into the next sample."""

    @property
    def order(self) -> int:
        """Order of convergence."""
        ...

    @property
    def past(self) -> int:
        """Measured samples a prediction starts from, the present one included."""
        ...

    def advance(self, field: Field, history: JaxArray) -> JaxArray:
        """Return the next state.

        Parameters
        ----------
        field : Field
            Derivative around the present sample.
        history : array, shape (past, state, batch)
            Present state first, then older ones.

        Returns
        -------
        array, shape (state, batch)
        """
        ...
