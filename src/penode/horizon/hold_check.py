"""How inputs go on between samples, asked of the recordings: before a fit, and after it.

What is trained for it shows as well how many sub-steps a sample the solver wants.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Climb, HorizonFit, LadderProblem, ignore_events
from penode.horizon.selection import Longest
from penode.horizon.solver_check import too_coarse
from penode.models.base import Model
from penode.models.measured import measured_units
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.holds import FirstOrderHold, Hold, ZeroOrderHold
from penode.predictors.solver import Solver
from penode.training.local_loss import LocalLoss
from penode.training.plan import Plan, Problem, Solution
from penode.training.second_order import LevenbergMarquardt

#: Holds that are compared, the simplest first.
_HOLDS: tuple[Hold, ...] = (ZeroOrderHold(), FirstOrderHold(), BandLimitedHold())
#: A loss that is rounding, and the logarithm of one that diverged.
_EXACT, _DIVERGED = 1e-24, 1e3
#: Log likelihood below which two holds are as good before a fit, and above which one is worth
#: another climb after it; and evaluations of training with another one.
_TIE, _BETTER, _EVALUATIONS = 0.1, 1.0, 30
#: Damping of a step that is as good as free.
_NEARLY_FREE = 1e-6


def with_hold(plan: Plan, start: Start, experiments: Sequence[Experiment]) -> Plan:
    """Return a plan whose hold predicts the recordings best; of those as good the simplest.

    By minimax regret: of each hold counts the horizon at which its loss exceeds the least of all
    holds most. That may be the first, or one in the middle, where noise hides it in the first. The
    solver is as fine as the longest of these horizons wants. Horizons at which training with
    constant inputs ends before it has converged compare nothing; with none left the plan's hold
    stays, and the climb's end is asked instead (`better_hold`).
    """
    if not start.model.inputs:
        return plan
    middle = len(plan.stages) // 2
    stages = tuple(plan.stages[k] for k in sorted({0, (middle + 1) // 2, middle}))
    first = _Trial.of(replace(plan, stages=stages), start, experiments)
    if not first.comparable:
        return plan
    plans = [plan, *(replace(plan, hold=hold) for hold in _HOLDS[1:])]
    chance, trials, best = _TIE / _values(start.model, experiments), [first], 0
    for p in plans[1:]:
        trials.append(_Trial.of(replace(p, stages=stages), start, experiments))
        losses = np.array([trial.log_losses for trial in trials])[:, first.comparable]
        regret = np.max(losses - losses.min(axis=0), axis=1)
        best = int(np.argmax(regret <= regret.min() + chance))
        if best == 0:  # no signal that goes on smoothly stands still better than straight
            break
    solver = trials[best].fine_solver
    return plans[best] if solver == plan.solver else replace(plans[best], solver=solver)


@dataclass(frozen=True, eq=False)
class _Trial:
    """What training at a few horizons with one hold ends with."""

    plan: Plan
    problem: LadderProblem
    ends: Sequence[tuple[Problem, Solution]]

    @classmethod
    def of(cls, plan: Plan, start: Start, experiments: Sequence[Experiment]) -> "_Trial":
        problem = LadderProblem.of(start.model, experiments, plan, ignore_events)
        raw = problem.objective.layout.raw(start.model)
        return cls(plan, problem, list(problem.solutions(plan, raw)))

    @property
    def log_losses(self) -> list[float]:
        """The logarithm of the loss at each horizon."""
        known = [math.log(solution.terms.loss + _EXACT) for _, solution in self.ends]
        return known + [_DIVERGED] * (len(self.plan.stages) - len(known))

    @property
    def comparable(self) -> list[int]:
        """Indices of the horizons at which training converged, or predictions diverged."""
        unfinished = {k for k, (_, end) in enumerate(self.ends) if not end.converged}
        return [k for k in range(len(self.plan.stages)) if k not in unfinished]

    @property
    def fine_solver(self) -> Solver:
        """The solver with the sub-steps that the longest horizon wants, unless at an alias."""
        if len(self.ends) < len(self.plan.stages) or not self.ends[-1][1].converged:
            return self.plan.solver
        rung = self.problem.finished(self.plan.stages[-1].horizon, *self.ends[-1])
        choice = Longest().select((rung,))
        coarse = too_coarse(self.problem, self.plan, Climb((rung,), False), choice)
        if coarse is None or coarse.near is None:
            return self.plan.solver
        return coarse.finer or self.plan.solver


def better_hold(
    problem: LadderProblem, plan: Plan, rung: HorizonFit
) -> tuple[Plan, FloatArray] | None:
    """Return a plan whose hold explains a rung better, and raw parameters there; None without one.

    What noise hides at short horizons may decide at the chosen one, by which the parameters are
    surest. Training goes on from the rung's parameters with each other hold.
    """
    if not problem.model.inputs or plan.hold not in _HOLDS:
        return None
    losses, found = [rung.solution.terms.loss], [(plan, rung.solution.raw)]
    for hold in _HOLDS:
        if hold == plan.hold:
            continue
        changed = replace(plan, hold=hold)
        other = problem.with_predictor(changed, rung)
        if _beyond(other, rung.solution.raw, losses[0]):
            if plan.hold == _HOLDS[0]:  # nor does it go on smoothly
                break
            continue
        trained = LevenbergMarquardt(_EVALUATIONS).minimise(other, rung.solution.raw)
        if trained.terms.finite:
            losses.append(trained.terms.loss)
            found.append((changed, trained.raw))
    best = int(np.argmin(losses))
    gain = 0.5 * _values(problem.model, problem.experiments)
    gain *= math.log((losses[0] + _EXACT) / (losses[best] + _EXACT))
    return found[best] if gain > _BETTER else None


def _beyond(problem: Problem, raw: FloatArray, loss: float) -> bool:
    """Whether even twice the decrease that Gauss and Newton promise at raw leaves more than a loss.

    One evaluation in place of a training, for a hold by which parameters would be others.
    """
    here = problem.gauss_newton(raw)
    if not here.finite:
        return False
    local = LocalLoss(problem, raw, here)
    return bool(here.loss - 2 * local.promised(local.step(_NEARLY_FREE)) > loss)


def _values(model: Model, experiments: Sequence[Experiment]) -> int:
    """Return how many values were measured."""
    return len(measured_units(model)) * sum(map(len, experiments))
