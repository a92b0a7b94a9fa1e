"""A plant over time by LSODA, from one break of its inputs to the next; no code of penode."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from penode.arrays import FloatArray
from validate.physics.misfits import Plant
from validate.physics.signals import Path, all_breaks

#: Relative and absolute tolerance, SI units, and evaluations a sample before a run is given up.
_RELATIVE, _ABSOLUTE, _MOST = 1e-8, 1e-9, 300


class _RunsAwayError(Exception):
    """The states left the range of numbers, or need more evaluations than are allowed."""


def simulate(
    plant: Plant,
    parameters: Mapping[str, float],
    first: Sequence[float],
    drive: Sequence[Path],
    step: float,
    samples: int,
) -> FloatArray:
    """Return the states at the samples, (sample, state), nan from the break before they run away.

    Parameters
    ----------
    plant : callable
    parameters : mapping of str to float
        SI units.
    first : sequence of float
        State at the first sample, SI units.
    drive : sequence of Path
        Inputs.
    step : float
        Sampling interval, s.
    samples : int
    """
    states = np.full((samples, len(first)), np.nan)
    states[0], left = first, [_MOST * samples]

    def rates(t: float, x: FloatArray, pieces: Sequence) -> Sequence[float]:
        left[0] -= 1
        if left[0] < 0 or not np.isfinite(x).all():
            raise _RunsAwayError
        return plant(x.tolist(), [piece(t / step) for piece in pieces], parameters)

    now = np.array(first, dtype=float)
    try:
        for begin, end in pairwise(all_breaks(drive, samples)):
            pieces = [path.piece((begin + end) / 2) for path in drive]
            inner = np.arange(math.floor(begin) + 1, math.floor(end) + 1)
            times = np.unique([*inner * step, end * step])
            run = solve_ivp(
                rates, (begin * step, end * step), now, "LSODA", times, args=(pieces,),
                rtol=_RELATIVE, atol=_ABSOLUTE,
            )  # fmt: skip
            if not run.success:
                return states
            states[inner] = run.y.T[: len(inner)]
            now = run.y[:, -1]
    except (_RunsAwayError, OverflowError, ValueError, ZeroDivisionError):
        pass
    return states
