"""Is the solver fine enough? Twice as many sub-steps may move neither the estimate nor the error.

A coarse solver is a model of its own: training makes up for its error with the parameters, and may
end at an alias, a value at which a wrong solution goes through the samples.
"""

import math
from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.fit.outcome import Objection
from penode.horizon.consensus import Consensus
from penode.horizon.ladder import Climb, HorizonFit, LadderProblem
from penode.horizon.selection import Choice
from penode.models.base import Model
from penode.models.explicit_time import driving_channels, evaluated
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.predictors.implicit import jacobian_of
from penode.predictors.one_step import Substeps
from penode.predictors.solver import Solver
from penode.training.gauss_newton_terms import residual_scale
from penode.training.loss import channel_deviation
from penode.training.plan import Plan, Problem

#: Part of a parameter's deviation, and of its value where that is more, that a solver may move it
#: by; part of the squared error, and of what the states move, that it may change the error by.
_PART, _FINEST = 0.1, 1e-5
_SQUARES, _VISIBLE = 0.2, 1e-3
#: Most sub-steps that are tried, and the fastest rate times their length that is not stiff.
MOST, _STIFF = 16, 1.0
#: Part of a value, where that is more than its deviation, from which a move may lead from an alias.
_ALIAS = 0.1
#: Rate times sampling interval from which a transient has died out at the next sample.
_GONE = 3.0
#: Samples at which rates are looked at, the relative step of a parameter by which its part in them
#: is seen, and the least such part, logarithmic.
_SAMPLES, _STEP, _SETS = 200, 1e-3, 0.1


@dataclass(frozen=True)
class Coarseness:
    """A solver that is too coarse for what was trained with it."""

    solver: Solver
    # Sub-steps that suffice by the solver's order; above `MOST` where that is out of reach.
    count: int
    reason: str
    # Fastest rate of the model along the recordings times the length of a sub-step.
    stiffness: float
    # Raw parameters where a finer solver begins; None where these may be an alias, which a finer
    # solver predicts worse with than with those at the start.
    near: FloatArray | None = None

    @property
    def finer(self) -> Solver | None:
        """The solver with as many sub-steps as suffice, or as are tried; None if it has those."""
        count = min(self.count, MOST)
        return with_substeps(self.solver, count) if count > substeps(self.solver) else None

    @property
    def objection(self) -> Objection:
        """What speaks against a result that was trained so."""
        stiff = self.stiffness > _STIFF
        enough = f"Take {self.count} sub-steps a sample (Substeps)"
        if self.count > MOST:
            enough = f"More than {MOST} sub-steps are needed"
        implicit = (
            " The model is stiff: ImplicitMidpoint or Trapezoidal takes longer steps, unless its "
            "fastest rate is what is wanted; that takes faster samples."
        )
        return Objection("solver too coarse", self.reason, f"{enough}.{implicit if stiff else ''}")


def substeps(solver: Solver) -> int:
    """Return how many steps a solver takes in a sample."""
    return solver.count if isinstance(solver, Substeps) else 1


def with_substeps(solver: Solver, count: int) -> Solver:
    """Return a one-step solver that takes as many steps in a sample."""
    return Substeps(solver.solver if isinstance(solver, Substeps) else solver, count)


def too_coarse(
    problem: LadderProblem, plan: Plan, climb: Climb, choice: Choice
) -> Coarseness | None:
    """Return what twice as many sub-steps show of the solver at the chosen rung, if too coarse.

    To first order the minimum moves by A^-1 times the change of the descent S'r: one evaluation
    takes the place of another training. It is too coarse if a physical parameter moves by more than
    a tenth of its deviation, or the error by what a person would see. At an alias deviations may be
    unknown; then the model's fastest rate may not be fast beside a step either.
    """
    if problem.objective.predictor.past > 1:
        return None
    rung, names = climb.fits[choice.index], problem.objective.layout.physical
    said = Consensus.reported(choice, climb.fits)
    limits = np.maximum(_PART * said.deviation, _FINEST * np.abs(said.values))
    again, step, moved, seen = _doubled(problem, plan, rung)
    shares = dict(zip(names, _share(moved, limits), strict=True))

    now = substeps(plan.solver)
    reason, excess = f"With {2 * now} sub-steps a sample the predictions change visibly.", seen
    worst = max(shares, key=lambda name: shares[name], default="")
    if worst and shares[worst] > max(seen, 1.0):
        k, excess = names.index(worst), shares[worst]
        reason = (
            f"With {2 * now} sub-steps a sample {worst} = {said.values[k]:.4g} moves by "
            f"{moved[k]:.2g}, which is more than a tenth of its deviation."
        )
    unsure = _unsure_rates(problem, rung, said) if excess <= 1.0 else []
    if excess <= 1.0 and not unsure:
        return None
    steps = rung.windows.time_steps
    slowest = rung.windows.time_step if steps is None else float(steps.max())
    fastest = _fastest(rung, rung.model) * slowest / now
    if unsure:
        excess = (fastest / _STIFF) ** plan.solver.order
        reason = (
            f"The model's fastest rate times a step of the solver is {fastest:.2g}, and the "
            f"recordings do not show {' and '.join(unsure)}: the solver may decide."
        )
    if excess <= 1.0:
        return None
    # What the doubling changed is nearly all of the error, and falls by 2^order a doubling.
    doublings = max(math.ceil(math.log2(min(excess, 1e30)) / plan.solver.order), 1)
    known = np.where(np.isfinite(said.deviation), said.deviation, 0.0)
    near, alias = rung.solution.raw, bool(unsure)
    if (np.abs(moved) <= np.maximum(_ALIAS * np.abs(said.values), known)).all():
        near = near + step
    else:
        start = problem.objective.layout.raw(problem.model)
        alias = alias or again.better(near, start) is start
    return Coarseness(plan.solver, now * 2**doublings, reason, fastest, None if alias else near)


def too_fast(
    problem: LadderProblem, plan: Plan, climb: Climb, choice: Choice
) -> tuple[Objection, ...]:
    """Return the objection to parameters of a rate that is gone before the next sample."""
    rung = climb.fits[choice.index]
    unsure = _unsure_rates(problem, rung, Consensus.reported(choice, climb.fits))
    rate = _fastest(rung, rung.model) * rung.predictor.time_step if unsure else 0.0
    if rate <= _GONE:
        return ()
    reason = (
        f"{' and '.join(unsure)} may be any number from this one up: the model's fastest rate "
        f"times the sampling interval is {rate:.2g}, so that nothing of it is left at the next "
        "sample."
    )
    return (Objection("faster than the samples", reason, "Sample faster, or fix that rate."),)


def _share(moved: FloatArray, limits: FloatArray) -> FloatArray:
    """Return what the solver moves over what it may, huge where that is no number."""
    share = np.abs(moved) / np.maximum(limits, 1e-300)
    return np.asarray(np.nan_to_num(np.where(np.isinf(limits), 0.0, share), nan=1e30, posinf=1e30))


def _doubled(
    problem: LadderProblem, plan: Plan, rung: HorizonFit
) -> tuple[Problem, FloatArray, FloatArray, float]:
    """Return the problem of twice as many sub-steps, and what they change.

    That is what raw and physical parameters (SI) move by, and the error's change over what is
    visible.
    """
    before = rung.objective or problem.objective
    solver = with_substeps(plan.solver, 2 * substeps(plan.solver))
    again = problem.with_predictor(replace(plan, solver=solver), rung)
    raw, terms = rung.solution.raw, rung.solution.terms
    physical = len(before.layout.physical)
    after = again.gauss_newton(raw, terms)
    if not after.finite:
        return again, np.zeros(len(raw)), np.full(physical, np.inf), np.inf
    step = terms.inverse @ (after.descent - terms.descent)
    compared = before.error.compared
    as_it_varies = replace(before.loss, scale=channel_deviation)
    spread = residual_scale(rung.model, rung.windows.measured, as_it_varies)
    moves = np.mean((spread / before.scale)[compared] ** 2)
    visible = _SQUARES * terms.loss + _VISIBLE**2 * moves
    seen = np.sqrt(abs(after.loss - terms.loss) / visible)
    moved = again.reported_jacobian(raw)[:physical] @ step
    return again, again.spread(step), moved, float(seen)


def _unsure_rates(problem: LadderProblem, rung: HorizonFit, said: Consensus) -> list[str]:
    """Return the physical parameters known to no digit that set the model's fastest rate."""
    layout, names = problem.objective.layout, problem.objective.layout.physical
    values, found = rung.values[: len(names)], list[str]()
    unknown = np.flatnonzero(~(said.deviation < np.abs(said.values)))
    rate = _fastest(rung, rung.model) if len(unknown) else 0.0
    for k in unknown:
        with float64():
            changed = values.copy()
            changed[k] *= 1 + _STEP
            other = layout.plain_model(layout.with_physical(rung.solution.raw, changed))
        if abs(_fastest(rung, other) - rate) > _SETS * _STEP * rate:
            found.append(names[k])
    return found


def _fastest(rung: HorizonFit, model: Model) -> float:
    """Return the fastest rate of a model along the recordings, 1/s."""
    windows = rung.windows
    at = np.unique(np.linspace(0, len(windows.states) - 1, _SAMPLES).astype(int))
    inputs = windows.inputs[at, : len(driving_channels(model))].T
    with float64():
        given = on_device(inputs), on_device(windows.states[at].T)
        slopes = np.asarray(_slopes(with_batch_axis(model), *given))
    finite = slopes[np.isfinite(slopes).all(axis=(1, 2))]
    rates = np.abs(np.linalg.eigvals(finite))
    return float(rates.max(initial=0.0))


@eqx.filter_jit
def _slopes(model: Model, inputs: JaxArray, states: JaxArray) -> JaxArray:
    """Return d(derivative)/d(state), (batch, state, state), of batched values."""
    u = Inputs(inputs, driving_channels(model))
    return jacobian_of(lambda x: evaluated(model, "derivative", x, u), model.corrected(states))
