"""Quasi-Newton descent by reverse mode: for more parameters than a normal matrix can have rows."""

import numpy as np
from scipy.optimize import minimize

from penode.arrays import FloatArray
from penode.training.plan import Problem, Progress, ignore_progress

#: Pairs of steps and changes of the gradient that stand for the curvature.
_MEMORY = 20
#: Loss, in that of the start, that stands for predictions that diverge: the line search turns back
#: from it, the less the smaller it is.
_DIVERGED = 10.0


def quasi_newton(
    problem: Problem, raw: FloatArray, iterations: int, progress: Progress = ignore_progress
) -> FloatArray:
    """Return raw parameters (parameter,) of less loss, by L-BFGS from `raw`.

    A physical parameter is moved in units of its start, so that units do not matter (D. C. Liu and
    J. Nocedal 1989, doi:10.1007/BF01589116).
    """
    objective, moving = problem.objective, problem.moving
    own = objective.layout.physical_members & (raw != 0)
    scale = np.where(own, np.abs(raw), 1.0)[moving]
    unit = objective.loss_and_gradient(raw, problem.windows)[0]

    def at(scaled: FloatArray) -> FloatArray:
        return raw + problem.spread(scale * scaled)

    def loss_and_slope(scaled: FloatArray) -> tuple[float, FloatArray]:
        loss, gradient = objective.loss_and_gradient(at(scaled), problem.windows)
        slope = scale * gradient[moving]
        if np.isfinite(loss) and np.isfinite(slope).all():
            return loss / unit, slope / unit
        return _DIVERGED, np.zeros(len(scaled))

    def report(intermediate_result: object) -> None:
        progress(at(intermediate_result.x), unit * float(intermediate_result.fun))  # type: ignore[attr-defined]

    options = {"maxiter": iterations, "maxcor": _MEMORY, "maxfun": 2 * iterations, "gtol": 1e-9}
    start = np.zeros(int(moving.sum()))
    found = minimize(
        loss_and_slope, start, jac=True, method="L-BFGS-B", callback=report, options=options
    )
    return at(found.x)
