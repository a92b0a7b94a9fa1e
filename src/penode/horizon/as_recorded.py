"""A climb with the hold and the sub-steps that the recordings want: examined, and climbed anew."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from penode.arrays import FloatArray
from penode.fit.outcome import Objection
from penode.horizon.cross_checks import CrossCheck, cross_check
from penode.horizon.hold_check import better_hold
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Climb, LadderProblem
from penode.horizon.selection import Choice
from penode.horizon.solver_check import Coarseness, too_coarse, too_fast
from penode.training.plan import Plan

#: Most climbs with another hold, and the part of the loss below which its gain may be that of a
#: better minimum instead.
_HOLDS, _LESS = 2, 0.9
#: Raw parameters (parameter,) where training begins, by horizon.
Begun: TypeAlias = Mapping[int, FloatArray]


@dataclass(frozen=True, eq=False)
class Climbed:
    """A plan, what became of it, and what speaks against its solver."""

    problem: LadderProblem
    plan: Plan
    climb: Climb
    choice: Choice
    objections: tuple[Objection, ...] = ()
    # None where the solver is fine, or was not examined.
    coarse: Coarseness | None = None

    def cross_checked(self, start: Start) -> CrossCheck:
        """Return what contradicts the choice."""
        return cross_check(self.problem, self.plan, self.climb, self.choice, start)

    @property
    def begun(self) -> Begun | None:
        """Where each horizon ended, the chosen one a step on; None if its solver made an alias."""
        fits = self.climb.fits
        if self.coarse is None or self.coarse.near is None:
            return None
        ends = {rung.horizon: rung.solution.raw for rung in fits}
        return {**ends, fits[self.choice.index].horizon: self.coarse.near}

    def loss_at(self, index: int) -> float:
        """Return the loss at a rung, infinite where it was not reached."""
        fits = self.climb.fits
        return fits[index].solution.terms.loss if index < len(fits) else math.inf


def climbed_as_recorded(plan: Plan, climbed: Callable[[Plan, Begun | None], Climbed]) -> Climbed:
    """Climb, and climb anew with another hold or more sub-steps where the recordings want them.

    `climbed` climbs a plan from what is begun, or from the start where None is given. What is too
    coarse with 16 sub-steps stays as an objection.
    """
    return fine_enough(_as_held(climbed(plan, None), climbed), climbed)


def _as_held(found: Climbed, climbed: Callable[[Plan, Begun | None], Climbed]) -> Climbed:
    """Return a climb, or one with a better hold, compared again where it leaves much less loss."""
    try:
        for _ in range(_HOLDS):
            if found.climb.interrupted:
                break
            index = found.choice.index
            other = better_hold(found.problem, found.plan, found.climb.fits[index])
            if other is None:
                break
            before, (changed, raw) = found, other
            found = climbed(changed, {changed.stages[0].horizon: raw})
            if not found.loss_at(index) < _LESS * before.loss_at(index):
                break
    except KeyboardInterrupt:
        return _stopped(found)
    return found


def fine_enough(found: Climbed, climbed: Callable[[Plan, Begun | None], Climbed]) -> Climbed:
    """Return a climb, made anew with more sub-steps as long as the recordings want them.

    Each horizon goes on from where it ended, unless the solver may have led to an alias.
    """
    try:
        found = examined(found)
        while found.coarse and found.coarse.finer:
            finer = replace(found.plan, solver=found.coarse.finer)
            found = examined(climbed(finer, found.begun))
    except KeyboardInterrupt:
        return _stopped(found)
    return found


def examined(found: Climbed) -> Climbed:
    """Return a climb with what its solver's check says; one that was interrupted as it is."""
    if found.climb.interrupted:
        return found
    try:
        given = found.problem, found.plan, found.climb, found.choice
        coarse = too_coarse(*given)
        raised = too_fast(*given) or ((coarse.objection,) if coarse else ())
        return replace(found, objections=raised, coarse=coarse)
    except KeyboardInterrupt:
        return _stopped(found)


def _stopped(found: Climbed) -> Climbed:
    """Return a climb whose checks a person has interrupted."""
    horizon = found.climb.fits[found.choice.index].horizon
    found.problem.observer({"event": "stop", "horizon": horizon})
    reason = f"The check of hold and solver was interrupted. Before it: {found.choice.reason}"
    choice = replace(found.choice, verdict="stopped", reason=reason)
    return replace(found, choice=choice, climb=replace(found.climb, interrupted=True))
