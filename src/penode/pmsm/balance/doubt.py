"""What may act though the model leaves it out: its part of the uncertainty budget."""

from dataclasses import dataclass

import numpy as np

from penode.data.experiment import Experiment
from penode.horizon.uncertainty_budget import Imperfection
from penode.pmsm.balance.voltage_balance import term_columns
from penode.pmsm.machine.space_vectors import less_voltage
from penode.pmsm.machine.term_registry import physical_values
from penode.pmsm.machine.terms import Term

#: -2 log evidence by which what is added has to be better.
CLEAR = 25.0
#: Probability from which a doubt is worth a row of the budget.
NOTICED = 0.01


def probability(deviations: float, equations: float) -> float:
    """Return how probable a parameter is, as against zero, of two equally likely before.

    `deviations` is the estimate over its standard deviation. Before the `equations`, independent
    ones, the parameter is believed to be about as large as one of them shows (unit information;
    Kass and Wasserman 1995, doi:10.1080/01621459.1995.10476592).
    """
    return share(float(np.log(max(equations, 1.0))), min(deviations**2, 1e3))


def share(one: float, other: float) -> float:
    """Return how probable one of two is by the -2 log evidence of both, equally likely before."""
    return float(1 / (1 + np.exp(0.5 * np.clip(one - other, -1e3, 1e3))))


@dataclass(frozen=True)
class Doubt:
    """A term that may act though the model leaves it out, or has another in its place."""

    # This and the remedy: see `Imperfection`.
    source: str
    remedy: str
    # With the values that it would have.
    term: Term
    # What the model has in its place.
    instead: Term | None
    # Root of the probability that it acts.
    weight: float

    @property
    def imperfection(self) -> Imperfection:
        """Its effect by one standard deviation: the root mean square of acting and not acting."""
        other = "left out" if self.instead is None else "another shape"
        probable = f"{other}, {100 * self.weight**2:.2g} % probable"
        return Imperfection(self.source, probable, self.remedy, self.applied)

    def applied(self, experiment: Experiment, count: float) -> Experiment:
        """Return a recording with the voltage that would be left if the term acted."""
        taken = _dropped(experiment, self.term)
        if self.instead is not None:
            taken = taken - _dropped(experiment, self.instead)
        return less_voltage(experiment, count * self.weight * taken)


def _dropped(experiment: Experiment, term: Term) -> np.ndarray:
    """Return the voltage (time, 2) across a term whose parameters are known."""
    known, by_parameter, _ = term_columns(experiment, (term,))
    return np.asarray(known + by_parameter @ np.array([*physical_values((term,)).values()]))
