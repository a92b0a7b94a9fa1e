"""A climb whose solver is fine enough: it is examined, and climbed anew with more sub-steps."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from penode.arrays import FloatArray
from penode.fit.outcome import Objection
from penode.horizon.cross_checks import CrossCheck, cross_check
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Climb, LadderProblem
from penode.horizon.selection import Choice
from penode.horizon.solver_check import Coarseness, too_coarse, too_fast
from penode.training.plan import Plan


@dataclass(frozen=True, eq=False)
class Climbed:
    """A plan, what became of it, and what speaks against its solver.

    Attributes
    ----------
    problem : LadderProblem
    plan : Plan
    climb : Climb
    choice : Choice
    objections : tuple of Objection
        What the check of the solver says against the result; nothing where none was made.
    coarse : Coarseness or None
        None where the solver is fine, or was not examined.
    """

    problem: LadderProblem
    plan: Plan
    climb: Climb
    choice: Choice
    objections: tuple[Objection, ...] = ()
    coarse: Coarseness | None = None

    def cross_checked(self, start: Start) -> CrossCheck:
        """Return what contradicts the choice."""
        return cross_check(self.problem, self.plan, self.climb, self.choice, start)

    def loss_at(self, choice: Choice) -> float:
        """Return the loss at a rung that was chosen, infinite where it was not reached."""
        fits = self.climb.fits
        return fits[choice.index].solution.terms.loss if choice.index < len(fits) else math.inf


def with_fine_solver(plan: Plan, climbed: Callable[[Plan, FloatArray | None], Climbed]) -> Climbed:
    """Climb, and climb anew with more sub-steps until they do not move the estimate.

    What is too coarse with 16 of them stays as an objection.

    Parameters
    ----------
    plan : Plan
    climbed : callable
        Climbs a plan from raw parameters (parameter,), or from the start where None is given.
    """
    found = examined(climbed(plan, None))
    while found.coarse and found.coarse.finer:
        finer = replace(found.plan, solver=found.coarse.finer)
        found = examined(climbed(finer, found.coarse.near))
    return found


def examined(found: Climbed) -> Climbed:
    """Return a climb with what its solver's check says; one that was interrupted as it is.

    Parameters
    ----------
    found : Climbed
    """
    if found.climb.interrupted:
        return found
    try:
        given = found.problem, found.plan, found.climb, found.choice
        coarse = too_coarse(*given)
        raised = too_fast(*given) or ((coarse.objection,) if coarse else ())
        return replace(found, objections=raised, coarse=coarse)
    except KeyboardInterrupt:
        horizon = found.climb.fits[found.choice.index].horizon
        found.problem.observer({"event": "stop", "horizon": horizon})
        reason = f"The check of the solver was interrupted. Before it: {found.choice.reason}"
        choice = replace(found.choice, verdict="stopped", reason=reason)
        return replace(found, choice=choice, climb=replace(found.climb, interrupted=True))
