"""Several starts where one may end in a poor minimum."""

from dataclasses import dataclass, replace

from penode.arrays import FloatArray
from penode.models.base import Model
from penode.training.plan import DIVERGED, Optimiser, Problem, Progress, Solution, ignore_progress


@dataclass(frozen=True, eq=False)
class BestOf:
    """An optimiser run from further starts too; the lowest loss is kept.

    Networks have many minima, and which one a draw leads to is chance. It costs least at a short
    horizon, as the first stage of a plan.

    Attributes
    ----------
    optimiser : Optimiser
        Runs from where the stage begins, and from every further start.
    starts : tuple of Model
        Of the model's structure. Parameters that the stage holds are taken from where it begins.
    """

    optimiser: Optimiser
    starts: tuple[Model, ...]

    def minimise(
        self, problem: Problem, raw: FloatArray, progress: Progress = ignore_progress
    ) -> Solution:
        """Return the best solution from `raw` (parameter,) or a further start."""
        layout, held = problem.objective.layout, ~problem.moving
        raws = [raw, *(layout.raw(start) for start in self.starts)]
        for other in raws[1:]:
            other[held] = raw[held]
        solutions = [self.optimiser.minimise(problem, start, progress) for start in raws]
        ended = [solution for solution in solutions if solution.outcome != DIVERGED]
        best = min(ended or solutions[:1], key=lambda solution: solution.terms.loss)
        return replace(best, evaluations=sum(solution.evaluations for solution in solutions))
