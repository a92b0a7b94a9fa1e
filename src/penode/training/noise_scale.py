"""The scale of noise with outliers, estimated where training is."""

from dataclasses import replace

import numpy as np

from penode.arrays import FloatArray
from penode.training.chunks import summed
from penode.training.coarse_to_fine import CoarseToFine
from penode.training.moments import moments
from penode.training.plan import DIVERGED, Problem
from penode.training.second_order import LevenbergMarquardt

#: Relative change of a scale from which it is settled, most passes, and least scale in units of
#: the loss's.
_SETTLED, _PASSES, _LEAST = 1e-3, 50, 1e-9
#: Trainings, each with the scale estimated after the one before; the first, and those after it.
_ROUNDS = 6
_COLD, _WARM = CoarseToFine(LevenbergMarquardt(evaluations=60)), LevenbergMarquardt(evaluations=15)


def with_scale(problem: Problem, raw: FloatArray, cold: bool) -> tuple[Problem, FloatArray]:
    """Return the problem with the most likely scale of its noise, and where training begins.

    `raw` (parameter,) is where it would begin, `cold` whether nothing was trained before. Scale and
    parameters are estimated in turn.
    """
    noise = problem.objective.loss.noise
    if noise is None or noise.scale is not None:
        return problem, raw
    for number in range(_ROUNDS):
        before, problem = problem.objective.noise_scale, _scaled(problem, raw)
        now = problem.objective.noise_scale
        if number and np.all(np.abs(now / before - 1) < 10 * _SETTLED):
            break
        optimiser = _COLD if cold and not number else _WARM
        solution = optimiser.minimise(problem, raw)
        if solution.outcome == DIVERGED:
            break
        raw = solution.raw
    return problem, raw


def _scaled(problem: Problem, raw: FloatArray) -> Problem:
    """Return the problem with the scale that is most likely at raw (parameter,)."""
    objective, windows = problem.objective, problem.windows
    corrections = summed(objective.error, raw, windows, normal=False).starts
    for _ in range(_PASSES):
        w, squares, _ = moments(objective.error, raw, windows, corrections)
        # J. T. Kent et al., Commun. Stat. Simul. 23 (1994) 441, doi:10.1080/03610919408813180.
        factor = np.sqrt(squares / np.maximum(w, 1e-300))
        if not np.isfinite(factor).all():
            return problem
        scale = objective.noise_scale.copy()
        scale[objective.error.compared] *= factor
        objective = objective.with_noise_scale(np.maximum(scale, _LEAST))
        if np.all(np.abs(factor - 1) < _SETTLED):
            break
    return replace(problem, objective=objective)
