"""What the data determine of a physical parameter, before and beside any training."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from penode.horizon.objections import Check
from penode.horizon.uncertainty_budget import Imperfection
from penode.models.base import Model
from penode.training.penalties import Penalty
from penode.training.plan import Plan
from penode.training.steady_points import SteadyPoints

#: Below this independence a parameter and the learned map can stand in for each other.
THRESHOLD = 0.01


@dataclass(frozen=True, eq=False)
class Start:
    """Where training begins, and what the data determine of each physical parameter.

    Attributes
    ----------
    model : Model
        Untrained model, or one started by the weak form, with physical values.
    identifiability : mapping of str to float
        Fraction of each physical parameter's low-passed regressor that no regressor of the learned
        map explains; a parameter without an entry was not examined.
    anchor : mapping of str to (float, float)
        What a method without a horizon finds of a physical parameter, and its deviation, in SI
        units: the weak form, for instance.
    repair : str
        The cheapest change of the recording or the model that would help, as a sentence.
    facts : mapping
        Joins the provenance of the fit: how the model came about.
    warnings : tuple of str
        Joins those of the fit: what is odd in the recordings, a sentence each.
    penalties : tuple of Penalty
        Join those of the plan's loss: what is known of the learned map before training.
    checks : tuple of Check
        What the fit is examined for beside `penode.horizon.objections.CHECKS`.
    imperfections : tuple of Imperfection
        Of the recordings, by one standard deviation each; they join the uncertainty budget.
    left_out : callable, optional
        Takes the trained model; returns further imperfections for what it leaves out, if anything.
    points : SteadyPoints, optional
        At which the plant was at rest: they are fitted together with the recordings.
    """

    model: Model
    identifiability: Mapping[str, float] = field(default_factory=dict)
    anchor: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    repair: str = "Record another regime, or use a learned map with more structure."
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    penalties: tuple[Penalty, ...] = ()
    checks: tuple[Check, ...] = ()
    imperfections: tuple[Imperfection, ...] = ()
    left_out: Callable[[Any], tuple[Imperfection, ...]] | None = None
    points: SteadyPoints | None = None

    def with_penalties(self, plan: Plan) -> Plan:
        """Return a plan with what is known of the learned map in its loss."""
        penalties = (*plan.loss.penalties, *self.penalties)
        return replace(plan, loss=replace(plan.loss, penalties=penalties))

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Physical parameters that the data cannot distinguish from the learned map."""
        return tuple(n for n, rho in self.identifiability.items() if rho < THRESHOLD)
