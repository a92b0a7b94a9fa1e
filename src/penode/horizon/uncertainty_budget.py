"""Uncertainty budget: what each source of error contributes to a reported quantity.

After the Guide to the Expression of Uncertainty in Measurement (JCGM 100:2008): contributions of
statistics (type A) and of what is believed of the recording chain (type B) are standard deviations
that add in squares.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.fit.outcome import Contribution
from penode.horizon.consensus import (
    BESIDE,
    BETWEEN,
    DECLARED,
    HORIZON,
    LEFT_OUT,
    PRIOR,
    STATISTICS,
)
from penode.horizon.ladder import HorizonFit, LadderProblem
from penode.training.plan import Plan, Stage

#: What would make smaller what the data themselves show.
_REMEDIES = {
    STATISTICS: "Record longer, or with less noise.",
    HORIZON: "Add to the model what its residual still shows.",
    PRIOR: "Record more operating points.",
    DECLARED: "Record what shows these parameters, or know them better beforehand.",
    BESIDE: "Measure more points at rest, or more exactly.",
    BETWEEN: "Look at what differs between the recordings, such as the temperature.",
    LEFT_OUT: "Add to the model what its residual still shows.",
}


#: Standard deviations of an imperfection by which its slope is taken: over a window errors grow,
#: and one of 0.5 % in every voltage is no small one.
_SMALL = 1e-5


@dataclass(frozen=True)
class Imperfection:
    """One way in which recordings may differ from what happened, by one standard deviation.

    Attributes
    ----------
    source : str
        What it is, in a few words; imperfections of one source are one row of the budget.
    accuracy : str
        The standard deviation, such as ``"0.5 %"``.
    remedy : str
        What would make it smaller, as a sentence.
    applied : callable
        Takes an experiment and a number; returns the experiment with that many standard deviations
        of the imperfection added.
    origin : str
        See `penode.fit.outcome.Contribution`.
    """

    source: str
    accuracy: str
    remedy: str
    applied: Callable[[Experiment, float], Experiment]
    origin: str = ""


def raw_shifts(
    problem: LadderProblem,
    plan: Plan,
    stage: Stage,
    rung: HorizonFit,
    imperfections: Sequence[Imperfection],
) -> FloatArray:
    """Return what each imperfection moves the estimate by, shape (imperfection, parameter), raw.

    To first order the minimum moves by A^-1 times the change of S'r, the descent. Windows' starts
    that are far are looked for from the same ones before and after.
    """
    raw, terms = rung.solution.raw, rung.solution.terms
    shifts = np.zeros((len(imperfections), len(raw)))
    moving = problem.objective.layout.members(stage.groups)
    starts = terms.starts if terms.far else None

    def descent(experiments: Sequence[Experiment]) -> FloatArray:
        own = replace(problem, experiments=experiments).problem(stage, plan)
        return own.objective.descent(raw, own.windows, starts)[moving]

    before = descent(problem.experiments) if terms.far else terms.descent
    for shift, one in zip(shifts, imperfections, strict=True):
        after = descent([one.applied(e, _SMALL) for e in problem.experiments])
        shift[moving] = terms.inverse @ (after - before) / _SMALL
    return shifts


def budget(
    shown: Mapping[str, float], imperfections: Sequence[Imperfection], shifts: FloatArray
) -> tuple[Contribution, ...]:
    """Return a quantity's uncertainty budget, largest first, from parts and shifts in its unit."""
    rows = {
        source: Contribution(source, std, remedy=_REMEDIES.get(source, ""))
        for source, std in shown.items()
    }
    for one, shift in zip(imperfections, shifts, strict=True):
        others = rows[one.source].std if one.source in rows else 0.0
        total = float(np.nan_to_num(np.hypot(others, shift), nan=np.inf))
        rows[one.source] = Contribution(one.source, total, one.accuracy, one.remedy, one.origin)
    return tuple(sorted(rows.values(), key=lambda row: -row.std))
