"""Cross-checks of the chosen rung: against training from the start alone, and against an anchor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import FloatArray
from penode.fit.outcome import Objection
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Climb, HorizonFit, LadderProblem, strayed
from penode.horizon.selection import Choice
from penode.training.plan import DIVERGED, Plan, Stage

#: Deviations apart from which two answers disagree.
_APART = 4.0
#: Fraction of a value from which such a disagreement makes the result implausible.
_LARGE = 0.05


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

    def select(self, rungs: Sequence[HorizonFit]) -> Choice:
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
        gaps = np.nan_to_num(gaps, nan=np.inf, posinf=np.inf)
        agreeing = tuple(int(k) for k in np.flatnonzero(gaps < 2.0))
        if not agreeing:
            nearest = int(np.argmin(gaps))
            reason = "No horizon has an estimate to compare."
            if np.isfinite(gaps[nearest]):
                reason = (
                    "No horizon agrees with the estimate that needs none; H = "
                    f"{rungs[nearest].horizon} is {gaps[nearest]:.1f} deviations away."
                )
            return Choice(nearest, "no plateau", reason, tuple(range(len(rungs))))
        horizon = rungs[agreeing[0]].horizon
        reason = f"H = {horizon} is the shortest that agrees with the estimate that needs none."
        verdict = "plateau" if agreeing[0] else "H = 1 suffices"
        return Choice(agreeing[0], verdict, reason, agreeing)


@dataclass(frozen=True)
class CrossCheck:
    """What the cross-checks of a choice gave; objections make its result implausible."""

    contradictions: tuple[str, ...] = ()
    objections: tuple[Objection, ...] = ()
    interrupted: bool = False
    # A rung, and raw parameters of less loss there, found by training from the start alone.
    better: tuple[int, FloatArray] | None = None

    def beside(self, sentences: Sequence[str]) -> "CrossCheck":
        """Return the same with further contradictions."""
        return replace(self, contradictions=(*self.contradictions, *sentences))


def cross_check(
    problem: LadderProblem, plan: Plan, climb: Climb, choice: Choice, start: Start
) -> CrossCheck:
    """Return what contradicts the choice; nothing is checked after an interrupted climb."""
    if climb.interrupted:
        return CrossCheck()
    chosen, layout = climb.fits[choice.index], problem.objective.layout
    small, objections = check_against_anchor(chosen, layout.physical, start.anchor)
    checked = [(problem, choice.index)] if choice.index else []
    if strayed(climb.fits):  # and so may have the states that the path left for its windows
        checked.insert(0, (replace(problem, guesses={}), len(climb.fits) - 1))
    try:
        for cold, index in checked:
            rung = climb.fits[index]
            far, raw = check_path_dependence(cold, plan, rung, layout.raw(start.model))
            if raw is not None:
                return CrossCheck((*small, *far), objections, better=(index, raw))
    except KeyboardInterrupt:
        problem.observer({"event": "stop", "horizon": chosen.horizon})
        return CrossCheck(small, objections, interrupted=True)
    return CrossCheck(small, objections)


def check_against_anchor(
    rung: HorizonFit, names: Sequence[str], anchor: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], tuple[Objection, ...]]:
    """Return what physical parameters contradict their anchors: small ones, and objections.

    An anchor is a value and its deviation, SI units.
    """
    small, objections = [], []
    for k, name in enumerate(names):
        value, deviation = anchor.get(name, (np.nan, np.nan))
        gap = abs(rung.values[k] - value) / np.hypot(rung.working[k], deviation)
        if not gap > _APART:
            continue
        reason = (
            f"{name} = {rung.values[k]:.4g} contradicts {value:.4g} ± {deviation:.2g}, the "
            "estimate of the weak form of the balance without any training."
        )
        repair = "Something is missing in the model or wrong in the recording."
        if abs(rung.values[k] - value) > _LARGE * abs(value):
            objections.append(Objection("contradiction", reason, repair))
        else:
            small.append(f"{reason} {repair}")
    return tuple(small), tuple(objections)


def check_path_dependence(
    problem: LadderProblem, plan: Plan, chosen: HorizonFit, start: FloatArray
) -> tuple[tuple[str, ...], FloatArray | None]:
    """Train once more at a rung's horizon from the start, and return what contradicts the ladder.

    That is a sentence for each parameter that comes out elsewhere, at less loss, and the raw
    parameters (parameter,) there. Nothing is checked if the plan has no `detour`.
    """
    optimiser = plan.detour
    if optimiser is None:
        return (), None
    stage = next(stage for stage in plan.stages if stage.horizon == chosen.horizon)
    again = problem.problem(Stage(stage.horizon, optimiser, stage.groups), plan)
    direct = optimiser.minimise(again, start)
    if direct.outcome == DIVERGED or not direct.terms.loss <= chosen.solution.terms.loss:
        return (), None  # the ladder is no worse: its path served
    names = problem.objective.layout.physical
    gap = problem.reported.values(direct.raw)[: len(names)] - chosen.values[: len(names)]
    far = np.abs(gap) > chosen.working[: len(names)]
    lower = 100 * (1 - direct.terms.loss / chosen.solution.terms.loss)
    sentences = tuple(
        f"{name} depends on the path: trained at H = {chosen.horizon} from the start it comes out "
        f"as {chosen.values[k] + gap[k]:.4g}, not {chosen.values[k]:.4g}, at a loss lower by "
        f"{lower:.2g} %."
        for k, name in enumerate(names)
        if far[k]
    )
    return sentences, direct.raw if sentences else None
