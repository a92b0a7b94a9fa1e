"""Simulation beside estimation: the rung whose free run errs least, and what it says of a choice.

Where a model leaves something out, short and long horizons are biased by different parts of it.
One step at a time is best for a model that is right, several where states are not measured (M.
Somalwar et al., arXiv:2603.23465), and all at once for simulation.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from penode.arrays import FloatArray
from penode.fit.outcome import AGREED, NORMAL_95
from penode.horizon.consensus import Consensus
from penode.horizon.held_out import excess_errors, shortest_of_least
from penode.horizon.ladder import HorizonFit
from penode.horizon.selection import Choice
from penode.models.layout import Layout
from penode.validation.comparison import Comparison

#: Factors between errors of free runs: one that says nothing, and one that chance does not make.
_NEGLIGIBLE, _MUCH = 1.01, 1.5


def best_in_free_run(rungs: Sequence[HorizonFit]) -> int:
    """Return the index of the rung whose free run errs least, the shorter of two that are equal.

    No tolerance, as in `HeldOut`: 1 % of noise hides an error of the model of 14 % of that noise.
    """
    return shortest_of_least(np.log(_free_run_errors(rungs)))


def better_by_chance(one: Sequence[Comparison], other: Sequence[Comparison], past: int) -> bool:
    """Return whether free runs of one model err less than another's by no more than chance.

    Chance is judged over recordings, or stretches of a single one; `past` samples are not run.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        errors = [
            [((c.measured - c.free_run)[None, past:]) ** 2 for c in each] for each in (one, other)
        ]
    excess, deviation = excess_errors(errors, 0)
    return bool(excess[1] <= NORMAL_95 * deviation[1])


def confirmed(choice: Choice, rungs: Sequence[HorizonFit]) -> Choice:
    """Return a choice, refused where another horizon simulates much better with other parameters.

    Only the choice of a plateau is examined; any other is returned as it is.
    """
    found = _better(choice, rungs)
    if found is None or found[1] < _MUCH:
        return choice
    best, ratio, sentence = found
    longer = rungs[best].horizon > rungs[choice.index].horizon
    reason = (
        f"{choice.reason} But in free run they err {ratio:.2g} times as much as H = "
        f"{rungs[best].horizon}, {sentence}: {'short' if longer else 'long'} horizons are biased "
        "by what the model leaves out."
    )
    return replace(
        choice,
        index=best,
        verdict="no plateau",
        reason=reason,
        agreeing=tuple(range(len(rungs))),
    )


def simulating(choice: Choice, rungs: Sequence[HorizonFit]) -> Choice:
    """Return a choice, that of the best simulation where horizons do not agree.

    What is learned can make up for a bias at one horizon that another then has in free run.
    """
    if choice.verdict != "no plateau":
        return choice
    best = best_in_free_run(rungs)
    reason = f"{choice.reason} H = {rungs[best].horizon} has the least error in free run."
    return replace(choice, index=best, reason=reason, agreeing=tuple(range(len(rungs))))


def parting(choice: Choice, rungs: Sequence[HorizonFit]) -> tuple[str, ...]:
    """Return a sentence where the best simulation has other parameters than the plateau."""
    found = _better(choice, rungs)
    if found is None:
        return ()
    best, ratio, sentence = found
    return (
        f"Misfit: for simulation H = {rungs[best].horizon} is better, its free run errs "
        f"{100 * (1 - 1 / ratio):.0f} % less {sentence}; parameters are taken from the plateau, "
        "and `fit.simulation` is the model to simulate with.",
    )


def _better(choice: Choice, rungs: Sequence[HorizonFit]) -> tuple[int, float, str] | None:
    """Return a rung that simulates better with parameters outside the plateau's intervals.

    Better than every rung of the plateau: where motion is chaotic their errors differ by luck.
    """
    if choice.verdict not in AGREED:
        return None
    best, errors = best_in_free_run(rungs), _free_run_errors(rungs)
    together = Consensus.reported(choice, rungs)
    names = Layout(rungs[best].model).physical
    gap = np.abs(rungs[best].values[: len(names)] - together.values)
    outside = np.flatnonzero(gap > NORMAL_95 * together.deviation)
    ratio = float(errors[list(choice.agreeing)].min() / errors[best])
    if not len(outside) or not ratio > _NEGLIGIBLE:
        return None
    k = outside[int(np.argmax(gap[outside] / np.maximum(together.deviation[outside], 1e-300)))]
    return best, ratio, f"with {names[k]} = {rungs[best].values[k]:.4g} outside the interval"


def _free_run_errors(rungs: Sequence[HorizonFit]) -> FloatArray:
    """Return the geometric mean over states of each rung's free-run errors, (rung,)."""
    errors = np.stack([np.asarray(rung.free_run, dtype=float) for rung in rungs])
    logs = np.log(np.clip(errors, 1e-300, 1e300)).mean(axis=1)
    return np.asarray(np.exp(logs))
