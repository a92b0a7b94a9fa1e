"""Search: climb from a start, choose a horizon, and cross-check the choice."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.horizon.as_recorded import Begun, Climbed, climbed_as_recorded, examined, fine_enough
from penode.horizon.cross_checks import CrossCheck
from penode.horizon.free_runs import with_free_runs
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, Observer
from penode.horizon.selection import Selector, believable, choose
from penode.horizon.simulation import confirmed, parting, simulating
from penode.models.measured import dynamic_states
from penode.training.plan import Plan

#: Hidden states of each recording, where the search for windows' starts begins.
Guesses = Sequence[Mapping[str, FloatArray]]


@dataclass(frozen=True, eq=False)
class Found:
    """A climb, its choice, and what contradicts it."""

    start: Start
    climbed: Climbed
    check: CrossCheck


@dataclass(frozen=True, eq=False)
class Search:
    """What every climb of an identification has in common.

    `guesses`, where they are given, are for the first horizon.
    """

    start: Start
    experiments: Sequence[Experiment]
    selector: Selector
    observer: Observer
    guesses: Guesses = field(default_factory=tuple)

    def as_given(self, plan: Plan) -> Found:
        """Climb a plan as it is."""
        found = self._climbed(plan)
        return Found(self.start, found, found.cross_checked(self.start))

    def as_recorded(self, plan: Plan) -> Found:
        """Climb with the hold and the sub-steps that recordings want, from a better start too."""
        found = climbed_as_recorded(plan, self._climbed)
        check = found.cross_checked(self.start)
        if check.better is not None:
            rung, raw = check.better
            try:
                # Each horizon begins there, as a short one may lead astray again.
                again = self._climbed(found.plan, {s.horizon: raw for s in found.plan.stages})
                if again.loss_at(rung) < found.loss_at(rung):
                    found, check = examined(again), again.cross_checked(self.start)
            except KeyboardInterrupt:
                check = replace(check, interrupted=True)
        return self._compared(found, check)

    def with_hold_of(self, plan: Plan) -> Found:
        """Climb with a hold that was chosen already, and the sub-steps that recordings want."""
        climbed = fine_enough(self._climbed(plan), self._climbed)
        found = self._compared(climbed, climbed.cross_checked(self.start))
        choice = simulating(found.climbed.choice, climbed.climb.fits)
        return replace(found, climbed=replace(found.climbed, choice=choice))

    def _compared(self, found: Climbed, check: CrossCheck) -> Found:
        """Return what was found beside what its free runs say."""
        climb, choice = found.climb, confirmed(found.choice, found.climb.fits)
        if choice is not found.choice:  # unstable motion amplifies the noise of a first sample
            climb = with_free_runs(found.problem, climb, dynamic_states(self.start.model))
            choice = confirmed(found.choice, climb.fits)
        found = replace(found, climb=climb, choice=choice)
        return Found(self.start, found, check.beside(parting(choice, climb.fits)))

    def _climbed(self, plan: Plan, begun: Begun | None = None) -> Climbed:
        problem = LadderProblem.of(self.start.model, self.experiments, plan, self.observer)
        if self.guesses:
            problem.guesses[plan.stages[0].horizon] = self.guesses
        problem.begun.update(begun or {})
        start = problem.objective.layout.raw(self.start.model)
        climb = believable(with_free_runs(problem, problem.climb(plan, start)))
        return Climbed(problem, plan, climb, choose(self.selector, climb, plan))
