"""Adams-Bashforth methods: slopes at past samples, fed by measurements at a window's start."""

from dataclasses import dataclass

from penode.arrays import JaxArray
from penode.predictors.field import Field
from penode.predictors.one_step import weighted
from penode.predictors.tableaus import AdamsBashforthTable


@dataclass(frozen=True)
class AdamsBashforth:
    """An explicit multistep method (paper, explicit multistep predictor).

    Attributes
    ----------
    table : AdamsBashforthTable
    """

    table: AdamsBashforthTable

    def __str__(self) -> str:
        return self.table.name

    @property
    def order(self) -> int:
        """Order of convergence."""
        return self.table.order

    @property
    def past(self) -> int:
        """Measured samples a prediction starts from."""
        return self.table.order

    def advance(self, field: Field, history: JaxArray) -> JaxArray:
        """Return the next state (state, batch) from history (past, state, batch)."""
        slopes = [field(history[j], sample=-j) for j in range(self.past)]
        return history[0] + field.width * weighted(self.table.b, slopes)
