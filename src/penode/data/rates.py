"""Sampling intervals of recordings: which are the same, and how long a horizon is in each."""

from collections.abc import Sequence

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError

#: Time steps that differ by less, relative, are one.
TOLERANCE = 1e-4


def time_steps(experiments: Sequence[Experiment]) -> FloatArray:
    """Return the time step of each recording in s, (experiment,), nearly equal ones as the first.

    The least of them is the step of which horizons are so many.
    """
    found: list[float] = []
    for experiment in experiments:
        own = experiment.time_step
        found.append(next((step for step in found if alike(step, own)), own))
    return np.array(found)


def alike(first: float, second: float) -> bool:
    """Return whether two time steps are one."""
    return abs(second - first) <= TOLERANCE * first


def steps_in(horizon: int, fastest: float, time_step: float) -> int:
    """Return how many steps of another length a horizon is, rounded, one at least.

    The horizon is in steps of the fastest recording; both lengths in s.
    """
    return horizon if alike(fastest, time_step) else max(round(horizon * fastest / time_step), 1)


def require_one_time_step(experiments: Sequence[Experiment]) -> None:
    """Refuse recordings of several time steps, where one is needed."""
    first, *others = experiments
    for other in others:
        if not alike(first.time_step, other.time_step):
            raise InputError(
                f"{other.name}: the time step is {other.time_step:.9g} s where {first.name} has "
                f"{first.time_step:.9g} s; resample one of them or fit them separately."
            )


def lengths(experiments: Sequence[Experiment]) -> list[int]:
    """Return the length of each recording in steps of the fastest one, (experiment,)."""
    steps = time_steps(experiments)
    ratios = steps / steps.min()
    return [int(len(e) * ratio) for e, ratio in zip(experiments, ratios, strict=True)]


def nearest(steps: Sequence[float] | FloatArray, experiment: Experiment) -> float:
    """Return which of several time steps is nearest to a recording's, s."""
    return float(min(steps, key=lambda step: abs(step - experiment.time_step)))
