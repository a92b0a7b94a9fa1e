"""Currents from flux linkages or voltages: Newton's method at many points at once."""

from collections.abc import Callable

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.pmsm.machine import frames

_ITERATIONS = 16
#: A point counts as found when its last step is below this share of its size, or of 1.
_TOLERANCE = 1e-10


def inverse(
    function: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
    targets: FloatArray,
    start: FloatArray,
) -> FloatArray:
    """Return where a function of two variables takes `targets` (2, point), NaN where it fails.

    Such as currents, A, to flux linkages, Vs; `slope` is its Jacobian (2, 2, point). First
    guesses are close ones: full Newton steps are taken.
    """
    solution = start.copy()
    converged: BoolArray = np.zeros(solution.shape[1], dtype=np.bool_)
    for _ in range(_ITERATIONS):
        step = solved(slope(solution), targets - function(solution))
        solution = solution + step
        converged = np.all(np.abs(step) <= _TOLERANCE * (1 + np.abs(solution)), axis=0)
        if (converged | np.isnan(step).any(axis=0)).all():
            break
    solution[:, ~converged] = np.nan
    return solution


def solved(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the solutions (2, point) of systems (2, 2, point) x = (2, point); NaN if singular."""
    with np.errstate(all="ignore"):
        solution: FloatArray = frames.solved(matrix, vector)
    solution[~np.isfinite(solution)] = np.nan
    return solution
