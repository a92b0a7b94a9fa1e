"""Free runs of a climb's rungs over the whole recordings."""

from collections.abc import Sequence
from dataclasses import replace

from penode.arrays import float64
from penode.horizon.ladder import Climb, LadderProblem
from penode.validation.free_run import free_run_errors


def with_free_runs(
    problem: LadderProblem, climb: Climb, free: Sequence[str] | None = None
) -> Climb:
    """Return a climb whose rungs know the errors of their free runs.

    States whose start is estimated are those that are not measured, unless `free` names them.
    """
    layout, experiments = problem.objective.layout, problem.experiments
    with float64():
        models = [
            [layout.plain_model(rung.solution.raw, k) for k in range(len(experiments))]
            for rung in climb.fits
        ]
    errors = free_run_errors(problem.objective.predictor, models, experiments, free)
    fits = (replace(rung, free_run=own) for rung, own in zip(climb.fits, errors, strict=True))
    return replace(climb, fits=tuple(fits))
