"""Cross-checks of the chosen rung: against training from the start alone, and against an anchor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.horizon.ladder import Ascent, RungFit
from penode.horizon.selection import Choice
from penode.training.plan import DIVERGED, Plan, Stage

#: Deviations apart from which two answers disagree.
_APART = 4.0


@dataclass(frozen=True)
class Anchor:
    """The shortest horizon that agrees with what a method without a horizon finds (Hausman).

    A consistent but unsure estimate judges surer ones: J. A. Hausman, Specification tests in
    econometrics, Econometrica 46 (1978) 1251, doi:10.2307/1913827. The variances are added, as the
    covariance of the two is not known; that is cautious.

    Attributes
    ----------
    values, deviation : ndarray, shape (physical,)
        What the other method finds, SI units.
    """

    values: FloatArray
    deviation: FloatArray

    def select(self, rungs: Sequence[RungFit]) -> Choice:
        """Return the choice among rungs, shortest horizon first."""
        count = len(self.values)
        gaps = np.array(
            [
                np.max(
                    np.abs(rung.values[:count] - self.values)
                    / np.hypot(rung.working[:count], self.deviation)
                )
                for rung in rungs
            ]
        )
        agreeing = tuple(int(k) for k in np.flatnonzero(gaps < 2.0))
        if not agreeing:
            nearest = int(np.argmin(gaps))
            reason = (
                f"No horizon agrees with the estimate that needs none; H = {rungs[nearest].horizon}"
                f" is {gaps[nearest]:.1f} deviations away."
            )
            return Choice(nearest, "no plateau", reason, tuple(range(len(rungs))))
        horizon = rungs[agreeing[0]].horizon
        reason = f"H = {horizon} is the shortest that agrees with the estimate that needs none."
        verdict = "plateau" if agreeing[0] else "H = 1 suffices"
        return Choice(agreeing[0], verdict, reason, agreeing)


def beside_anchor(
    rung: RungFit, names: Sequence[str], anchor: Mapping[str, tuple[float, float]]
) -> tuple[str, ...]:
    """Return a sentence for each physical parameter that contradicts its anchor.

    Parameters
    ----------
    rung : RungFit
        The chosen one.
    names : sequence of str
        Physical parameters.
    anchor : mapping of str to (float, float)
        Value and deviation, SI units.
    """
    told = []
    for k, name in enumerate(names):
        value, deviation = anchor.get(name, (np.nan, np.nan))
        gap = abs(rung.values[k] - value) / np.hypot(rung.working[k], deviation)
        if gap > _APART:
            told.append(
                f"{name} = {rung.values[k]:.4g} contradicts {value:.4g} ± {deviation:.2g}, which "
                "the weak form of the balance finds without any training; something is missing "
                "in the model or wrong in the recording."
            )
    return tuple(told)


def beside_direct(
    ascent: Ascent, plan: Plan, chosen: RungFit, start: FloatArray
) -> tuple[str, ...]:
    """Train once more at the chosen horizon from the start, and return what contradicts the ladder.

    Parameters
    ----------
    ascent : Ascent
        What the ladder was climbed with.
    plan : Plan
        Its `detour` trains; there is nothing to tell without one.
    chosen : RungFit
        The ladder's.
    start : ndarray, shape (parameter,)
        Raw parameters at which the ladder began.
    """
    optimiser = plan.detour
    if optimiser is None:
        return ()
    stage = next(stage for stage in plan.stages if stage.horizon == chosen.horizon)
    problem = ascent.problem(Stage(stage.horizon, optimiser, stage.groups), plan)
    direct = optimiser.minimise(problem, start)
    if direct.outcome == DIVERGED or not direct.terms.loss <= chosen.solution.terms.loss:
        return ()  # the ladder is no worse: its path served
    names = ascent.objective.layout.physical
    gap = ascent.reported.values(direct.raw)[: len(names)] - chosen.values[: len(names)]
    far = np.abs(gap) > chosen.working[: len(names)]
    lower = 100 * (1 - direct.terms.loss / chosen.solution.terms.loss)
    return tuple(
        f"{name} depends on the path: trained at H = {chosen.horizon} from the start it comes out "
        f"as {chosen.values[k] + gap[k]:.4g}, not {chosen.values[k]:.4g}, at a loss lower by "
        f"{lower:.2g} %."
        for k, name in enumerate(names)
        if far[k]
    )
