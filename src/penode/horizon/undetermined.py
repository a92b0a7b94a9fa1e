"""What recordings do not determine has an infinite interval, and an infinite interval its reason.

Where parameters act only together, such as a and b in a * b, the normal matrix is singular along
one direction. Its pseudo-inverse leaves that direction out, and each of them would look sure.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from penode.arrays import BoolArray, IntArray
from penode.fit.fit import Fit
from penode.horizon.ladder import Climb, HorizonFit, LadderProblem
from penode.horizon.selection import Choice
from penode.training.covariance import dominated, long_enough
from penode.training.gauss_newton_terms import marquardt_scale
from penode.training.plan import Plan

#: Squared share of a parameter in directions that change nothing, from which it is undetermined.
_FREE = 1e-4
#: Correlation along such directions from which another parameter is named beside it.
_TOGETHER = 0.3


@dataclass(frozen=True, eq=False)
class Determined:
    """Whether a rung determines each physical parameter.

    Attributes
    ----------
    rung : HorizonFit
    problem : LadderProblem
        What was climbed.
    moving : ndarray of bool, shape (parameter,)
        Raw parameters that moved.
    """

    rung: HorizonFit
    problem: LadderProblem
    moving: BoolArray

    @cached_property
    def places(self) -> IntArray:
        """Place of each physical parameter among those that moved, -1 for one held."""
        physical = np.flatnonzero(self.problem.objective.layout.physical_members)
        return np.where(self.moving[physical], np.cumsum(self.moving)[physical] - 1, -1)

    @property
    def unknown(self) -> BoolArray:
        """Which physical parameters, (physical,), may change without any effect, or were held."""
        terms = self.rung.solution.terms
        kept = np.einsum("kj,jk->k", terms.inverse[self.places], terms.normal[:, self.places])
        return np.asarray((self.places < 0) | ~(1 - kept < _FREE))

    def why(self, k: int) -> str:
        """Return why the physical parameter k is not known, and the mend."""
        rung, error = self.rung, self.problem.objective.error
        samples, spent = len(rung.windows.states), np.sum(error.stiffness == 0)
        if self.places[k] < 0:
            return "the plan holds it"
        if rung.solution.terms.normal[self.places[k], self.places[k]] == 0:
            return (
                "no prediction depends on it in these recordings; record where it acts, or give it "
                "a prior"
            )
        if self.unknown[k]:
            return (
                f"{self._together(k)}, and one makes up for the other; fix one, give it a prior, "
                "or measure what tells them apart"
            )
        if rung.horizon * len(error.compared) <= spent:
            return f"windows of {rung.horizon} steps are spent on their own starts; take longer"
        if not long_enough(rung.windows):
            return (
                f"{samples} samples are too few to show how residuals at horizon {rung.horizon} "
                "vary; record longer, or take shorter horizons"
            )
        if dominated(rung.influence)[k]:
            return "one or two windows decide it; look for what is odd in them"
        return (
            f"predictions at horizon {rung.horizon} are unstable, or errors cancel by chance; "
            "record longer, or take shorter horizons"
        )

    def _together(self, k: int) -> str:
        """Return what moves with a parameter along directions that change nothing."""
        terms, layout = self.rung.solution.terms, self.problem.objective.layout
        scale = marquardt_scale(terms.normal)
        free = np.eye(len(scale)) - (terms.inverse @ terms.normal) * np.outer(scale, 1 / scale)
        place, own = self.places[k], np.sqrt(np.maximum(np.diag(free), 1e-300))
        alike = np.abs(free[place]) / (own * own[place]) > _TOGETHER
        alike &= own**2 > _FREE
        names = [n for n, at in zip(layout.physical, self.places, strict=True) if alike[at]]
        if len(names) > 1:
            return f"{' and '.join(names)} act only together"
        return f"{layout.physical[k]} acts only together with what is learned"


def determined(climb: Climb, problem: LadderProblem, plan: Plan) -> Climb:
    """Return a climb whose rungs do not claim to know what they do not determine.

    Parameters
    ----------
    climb : Climb
    problem : LadderProblem
        What was climbed.
    plan : Plan
        By which it was climbed.
    """
    fits = []
    for rung, stage in zip(climb.fits, plan.stages, strict=False):
        unknown = Determined(rung, problem, problem.objective.layout.members(stage.groups)).unknown
        if unknown.any():
            deviations = np.stack([rung.deviation, rung.working])
            deviations[:, : len(unknown)][:, unknown] = np.inf
            rung = replace(rung, deviation=deviations[0], working=deviations[1])
        fits.append(rung)
    return replace(climb, fits=tuple(fits))


def with_reasons(fit: Fit, climb: Climb, choice: Choice, problem: LadderProblem, plan: Plan) -> Fit:
    """Return a fit whose warnings say why intervals are infinite, a sentence for each reason.

    Parameters
    ----------
    fit : Fit
    climb, choice, problem, plan
        What it was made of.
    """
    named: dict[str, list[str]] = {}
    for k, (name, estimate) in enumerate(fit.parameters.items()):
        if not np.isfinite(estimate.std):
            unsure = [i for i in choice.agreeing if not np.isfinite(climb.fits[i].deviation[k])]
            at = choice.index if choice.index in unsure or not unsure else unsure[-1]
            moving = problem.objective.layout.members(plan.stages[at].groups)
            reason = Determined(climb.fits[at], problem, moving).why(k)
            named.setdefault(reason, []).append(name)
    reasons = (f"The interval of {', '.join(n)} is infinite: {why}." for why, n in named.items())
    return replace(fit, warnings=(*fit.warnings, *reasons))
