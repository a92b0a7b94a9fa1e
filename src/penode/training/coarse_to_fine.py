"""Few windows first: far from a minimum a part of the recording shows the way as well."""

from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import FloatArray
from penode.training.plan import DIVERGED, Optimiser, Problem, Progress, Solution, ignore_progress

#: Residuals a moving parameter that are left at least.
_LEFT = 150


@dataclass(frozen=True)
class CoarseToFine:
    """An optimiser run on every n-th window first, and from where that ends on all of them.

    Attributes
    ----------
    optimiser : Optimiser
        Runs twice; its limit holds for each run.
    most : int
        Largest n. It is smaller where fewer than 150 residuals a parameter would be left, and 1,
        which leaves the first run out, where there are few windows.
    """

    optimiser: Optimiser
    most: int = 4

    def minimise(
        self, problem: Problem, raw: FloatArray, progress: Progress = ignore_progress
    ) -> Solution:
        """Lower the loss from `raw` (parameter,); coarse evaluations count by their fraction."""
        windows, error = problem.windows, problem.objective.error
        residuals = windows.steps.sum() * len(error.compared)
        stride = int(np.clip(residuals / (_LEFT * max(problem.moving.sum(), 1)), 1, self.most))
        if stride == 1:
            return self.optimiser.minimise(problem, raw, progress)
        few = replace(problem, windows=windows.among(slice(None, None, stride)))
        coarse = self.optimiser.minimise(few, raw, progress)
        begin = raw if coarse.outcome == DIVERGED else coarse.raw
        fine = self.optimiser.minimise(problem, begin, progress)
        return replace(fine, evaluations=fine.evaluations + -(-coarse.evaluations // stride))
