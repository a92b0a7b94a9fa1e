"""Ladder: the same fit at growing horizons, each warm-started by the one before."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from penode.arrays import BoolArray, FloatArray, float64
from penode.data.excitation import check_any_excitation
from penode.data.experiment import Experiment
from penode.data.rates import time_steps
from penode.data.stretches import by_recording, fewest_windows
from penode.data.windows import Jittered, Windows, cut
from penode.errors import InputError
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.measured import hidden_states, measured_units
from penode.predictors.base import Predictor
from penode.training.coarse_to_fine import CoarseToFine
from penode.training.covariance import (
    Reported,
    ScoreSeries,
    dominated_by_few_windows,
    influence,
    prior_covariance,
    sandwich_deviation,
    undetermined,
)
from penode.training.gauss_newton_terms import residual_scale
from penode.training.noise_scale import with_scale
from penode.training.plan import DIVERGED, Optimiser, Plan, Problem, Solution, Stage
from penode.training.residuals import Objective
from penode.training.second_order import LevenbergMarquardt
from penode.training.window_states import mean_states
from penode.validation.coverage import thin
from penode.validation.free_run import with_unmeasured

#: Receives an event, such as one evaluation or a finished horizon, as plain values.
Observer = Callable[[Mapping[str, Any]], None]


def ignore_events(event: Mapping[str, Any]) -> None:
    """Observe nothing."""


#: The longest are a few time constants of a drive: there the loss weighs R most.
HORIZONS = (1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 90, 135, 200, 300, 450)


def ladder_plan(
    horizons: Sequence[int] = HORIZONS, optimiser: Optimiser | None = None, seed: int = 0
) -> Plan:
    """Return the default plan: every horizon in turn, all parameters moving.

    Parameters
    ----------
    horizons : sequence of int
        Steps, ascending; the default grows by a factor of about 1.5 up to 450.
    optimiser : Optimiser, optional
        Levenberg-Marquardt by default, with more evaluations for the first rung, which alone
        starts cold; that one trains on every fourth window first.
    seed : int
        Seed of the jittered windows.

    Raises
    ------
    InputError
        If the horizons are not ascending whole numbers above 0.
    """
    if not horizons or min(horizons) < 1 or list(horizons) != sorted(set(horizons)):
        raise InputError(f"horizons must be ascending whole numbers above 0, got {list(horizons)}.")
    first = optimiser or CoarseToFine(LevenbergMarquardt(evaluations=60))
    later = optimiser or LevenbergMarquardt(evaluations=25)
    stages = (Stage(horizons[0], first), *(Stage(h, later) for h in horizons[1:]))
    return Plan(stages, Jittered(seed), detour=LevenbergMarquardt(evaluations=15))


def fitting_plan(plan: Plan, experiments: Sequence[Experiment]) -> Plan:
    """Drop stages whose horizon leaves fewer than 20 windows in the shortest recording."""
    enough = [s.horizon == 1 or fewest_windows(experiments, s.horizon) >= 20 for s in plan.stages]
    return replace(plan, stages=tuple(itertools.compress(plan.stages, enough)))


#: Why a deviation is not known where few windows outweigh all others.
_FEW = "one or two windows decide it; record longer, or excite more evenly"
#: Error of a horizon over that of the first from which predictions have exploded.
_EXPLODED = 1e6
#: Loss of the longest rung, over the least, from which the path may have led to another minimum;
#: and a share of a loss that is clearly less.
_STRAYED, _CLEARLY = 3.0, 0.99


@dataclass(frozen=True, eq=False)
class HorizonFit:
    """One rung of a climbed ladder.

    Attributes
    ----------
    horizon : int
        Steps, of the shortest length where recordings differ in it.
    solution : Solution
        Raw parameters, terms and outcome.
    values, deviation : ndarray, shape (reported,)
        Reported quantities, physical parameters first, and their HAC deviations, infinite where
        the recordings cannot show them; SI units.
    working : ndarray, shape (reported,)
        The same deviations however short the recordings: good enough to compare horizons by.
        Infinite where one or two windows decide.
    influence : ndarray, shape (physical, column)
        What each window contributed to each physical parameter, SI units; each sample where the
        windows are too long beside the recordings.
    windows : Windows
    series : ScoreSeries
        How the columns of influence and of the terms' scores lie in time.
    predictor : Predictor
    model : Model
        With the rung's parameters.
    prior : ndarray, shape (physical, physical), or 0
        Covariance of the physical parameters that Gaussian priors add, SI units.
    reasons : tuple of str
        Why the deviation of each physical parameter is not known; empty where it is.
    free_run : ndarray, shape (state,), or None
        Errors of a free run (rms), infinite where it diverged; None while they are not known.
    objective : Objective or None
        What was minimised, with the prior of a learned part; None stands for the problem's.
    """

    horizon: int
    solution: Solution
    values: FloatArray
    deviation: FloatArray
    working: FloatArray
    influence: FloatArray
    windows: Windows
    series: ScoreSeries
    predictor: Predictor
    model: Model
    prior: FloatArray | float = 0.0
    reasons: tuple[str, ...] = ()
    free_run: FloatArray | None = None
    objective: Objective | None = None


@dataclass(frozen=True, eq=False)
class Climb:
    """A climbed ladder.

    Attributes
    ----------
    fits : tuple of HorizonFit
        Shortest horizon first; at least one.
    interrupted : bool
        Whether a person stopped it by Ctrl-C before its end.
    """

    fits: tuple[HorizonFit, ...]
    interrupted: bool = False


@dataclass(frozen=True, eq=False)
class LadderProblem:
    """The same fit at several horizons, made concrete.

    Attributes
    ----------
    objective : Objective
    reported : Reported
        Quantities by which convergence is judged.
    model : Model
        Where training begins.
    experiments : sequence of Experiment
    observer : callable
        Receives an event for each evaluation and horizon.
    objectives : dict of int to Objective
        Those of rungs, whose noise or learned part has what was estimated there, by horizon; the
        climb fills it.
    guesses : dict of int to sequence of mapping
        Unmeasured states of each recording, by horizon: where the search for the windows' starts
        begins; the climb fills it, and where it has none the recordings have zeros or channels.
    begun : dict of int to ndarray
        Raw parameters where training begins, by horizon; else it begins where the last one ended.
    """

    objective: Objective
    reported: Reported
    model: Model
    experiments: Sequence[Experiment]
    observer: Observer
    objectives: dict[int, Objective] = field(default_factory=dict)
    guesses: dict[int, Sequence[Mapping[str, FloatArray]]] = field(default_factory=dict)
    begun: dict[int, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(
        cls, model: Model, experiments: Sequence[Experiment], plan: Plan, observer: Observer
    ) -> "LadderProblem":
        """Return what a plan's climb needs.

        Raises
        ------
        InputError
            If a channel is missing, or of all states in a unit none ever moves.
        """
        alike: dict[str, list[str]] = {}
        for name, unit in measured_units(model).items():
            alike.setdefault(unit, []).append(name)
        for stretches in by_recording(experiments):
            check_any_excitation(stretches, alike.values())
        whole = [with_unmeasured(e, model).stack(model.states) for e in experiments]
        visited = np.concatenate(whole)
        measured = visited
        if model.outputs:
            measured = np.concatenate([e.stack(tuple(model.outputs)) for e in experiments])
        predictor = Predictor(float(time_steps(experiments).min()), plan.solver, plan.hold)
        scale = residual_scale(model, measured, plan.loss)
        objective = Objective(predictor, model, scale, plan.loss, len(experiments))
        reported = Reported(objective.layout, thin(visited, most=100))
        return cls(objective, reported, model, experiments, observer)

    def climb(self, plan: Plan, raw: FloatArray) -> Climb:
        """Run the stages in order from raw (parameter,), ending early at a divergence or Ctrl-C.

        Raises
        ------
        InputError
            If already the first stage diverges.
        KeyboardInterrupt
            On Ctrl-C before the first horizon is finished.
        """
        rungs, interrupted = list[HorizonFit](), False
        try:
            self._climb(plan, raw, rungs)
        except KeyboardInterrupt:
            if not rungs:
                raise
            self.observer({"event": "stop", "horizon": rungs[-1].horizon})
            interrupted = True
        if not rungs:
            raise InputError(
                f"the predictions diverge already at horizon {plan.stages[0].horizon}; check the "
                "units and signs of the channels, or start from a better model."
            )
        return Climb(tuple(rungs), interrupted)

    def _climb(self, plan: Plan, raw: FloatArray, rungs: list[HorizonFit]) -> None:
        """Append finished rungs until the plan ends or a stage diverges."""
        for number, (problem, solution) in enumerate(self.solutions(plan, raw)):
            horizon = plan.stages[number].horizon
            self.objectives[horizon] = problem.objective
            rungs.append(self.finished(horizon, problem, solution))
            self._report(rungs[-1], (number + 1, len(plan.stages)))

    def solutions(self, plan: Plan, raw: FloatArray) -> Iterator[tuple[Problem, Solution]]:
        """Yield what each stage ends with, from raw (parameter,), until one diverges."""
        first, done, begun = raw, list[Solution](), dict(self.begun)
        for number, stage in enumerate(plan.stages):
            self.objectives.pop(stage.horizon, None)
            problem = self.problem(stage, plan)
            cold = not done and stage.horizon not in begun
            if stage.horizon in begun:
                raw = begun.pop(stage.horizon)
            elif done and _astray(problem, raw, done):
                problem, raw = self._nearest(stage, plan, problem, (raw, first))
            problem, raw = with_scale(problem, raw, cold)
            if plan.learned_prior:
                problem, raw = plan.learned_prior.joined(problem, raw, cold)
            progress = self.progress(stage.horizon, (number + 1, len(plan.stages)))
            solution = stage.optimiser.minimise(problem, raw, progress)
            if solution.outcome == DIVERGED:
                break
            if done and solution.terms.loss > _EXPLODED**2 * done[0].terms.loss:
                break  # so that longer horizons show nothing
            raw = solution.raw
            if hidden_states(self.model) and number + 1 < len(plan.stages):
                guesses = self.hidden_states(problem.objective, solution, problem.windows)
                self.guesses[plan.stages[number + 1].horizon] = guesses
            done.append(solution)
            yield problem, solution
            raw = np.where(self._lost(problem, solution), first, raw)

    def _nearest(
        self, stage: Stage, plan: Plan, guided: Problem, starts: tuple[FloatArray, FloatArray]
    ) -> tuple[Problem, FloatArray]:
        """Return the problem and start of least loss, with or without a guess of hidden states."""
        both = [guided]
        if stage.horizon in self.guesses:
            both.append(replace(self, guesses={}).problem(stage, plan))
        ends = [(problem, problem.better(*starts)) for problem in both]
        losses = np.nan_to_num([p.gauss_newton(raw).loss for p, raw in ends], nan=np.inf)
        if losses[-1] < _CLEARLY * losses[0]:
            del self.guesses[stage.horizon]
            return ends[-1]
        return ends[0]

    def problem(self, stage: Stage, plan: Plan) -> Problem:
        """Return the problem of one stage: its windows, and which parameters move."""
        predictor = self.objective.predictor
        guesses = self.guesses.get(stage.horizon, [{}] * len(self.experiments))
        guessed = [
            replace(e, channels={**e.channels, **guess})
            for e, guess in zip(self.experiments, guesses, strict=True)
        ]
        windows = cut(
            [with_unmeasured(e, self.model) for e in guessed],
            self.model.states,
            driving_channels(self.model),
            stage.horizon,
            output_names=tuple(self.model.outputs),
            past=self.objective.error.past,
            placement=plan.placement,
            prepared=predictor.prepared,
        )
        moving = self.objective.layout.members(stage.groups)
        objective = self.objectives.get(stage.horizon, self.objective)
        return Problem(objective, self.reported, windows, moving)

    def with_predictor(self, plan: Plan, rung: HorizonFit) -> Problem:
        """Return a rung's problem, predicted with the solver and hold of another plan."""
        before = rung.objective or self.objective
        predictor = Predictor(before.predictor.time_step, plan.solver, plan.hold)
        objective = Objective(
            predictor, self.model, before.scale, before.loss, before.layout.experiments
        )
        stage = next(stage for stage in plan.stages if stage.horizon == rung.horizon)
        return replace(self, objective=objective, objectives={}).problem(stage, plan)

    def hidden_states(
        self, objective: Objective, solution: Solution, windows: Windows
    ) -> list[dict[str, FloatArray]]:
        """Return the hidden states of each recording as windows have them where training ended.

        Long windows of a nonlinear model have several minima; shorter ones lead to the right.
        """
        mean = mean_states(objective.error, solution.raw, windows, solution.terms.starts)
        parts = np.split(mean, np.cumsum([len(e) for e in self.experiments])[:-1])
        own = [n for n in hidden_states(self.model) if n not in self.model.covariances]
        rows = {name: self.model.states.index(name) for name in own}
        return [
            {name: np.interp(np.arange(len(part)), at, part[at, k]) for name, k in rows.items()}
            if len(at := np.flatnonzero(np.isfinite(part).all(axis=1)))
            else {}
            for part in parts
        ]

    def finished(self, horizon: int, problem: Problem, solution: Solution) -> HorizonFit:
        """Return the fit of a horizon."""
        jacobian = problem.reported_jacobian(solution.raw)
        of_physical = jacobian[: len(self.objective.layout.physical)]
        few = dominated_by_few_windows(solution.terms, of_physical)
        solution, series = self._ordered(problem, solution, jacobian)
        working = sandwich_deviation(solution.terms, jacobian, series)
        blind = self._blind(problem, solution, of_physical)
        working[: len(few)][few | np.array([bool(names) for names in blind], dtype=bool)] = np.inf
        reason = self._unknown(horizon, series)
        deviation = np.where(bool(reason), np.inf, working)
        reasons = tuple(
            _together(names) if names else _FEW if of_few else reason
            for names, of_few in zip(blind, few, strict=True)
        )
        with float64():
            model = self.objective.layout.plain_model(solution.raw)
        return HorizonFit(
            horizon=horizon,
            solution=solution,
            values=self.reported.values(solution.raw),
            deviation=deviation,
            working=working,
            influence=influence(solution.terms, of_physical),
            windows=problem.windows,
            series=series,
            predictor=self.objective.predictor,
            model=model,
            prior=prior_covariance(solution.terms, of_physical),
            reasons=reasons,
            objective=problem.objective,
        )

    def _unknown(self, horizon: int, series: ScoreSeries) -> str:
        """Return why no deviation is known at a horizon; nothing where they are."""
        error = self.objective.error
        if horizon * len(error.compared) <= error.spent:
            return f"windows of {horizon} steps spend all they show on their own start"
        if not series.long_enough:
            return (
                f"{series.samples} samples are few beside the {series.bandwidth} over which what "
                "is left over is correlated; record longer"
            )
        return ""

    def _blind(
        self, problem: Problem, solution: Solution, of_physical: FloatArray
    ) -> list[list[str]]:
        """Return of each physical parameter those that the windows do not tell it from, or none."""
        names = np.array(self.objective.layout.raw_names)[problem.moving]
        parts = undetermined(solution.terms, of_physical)
        return [list(dict.fromkeys(names[row])) for row in parts]

    def _lost(self, problem: Problem, solution: Solution) -> BoolArray:
        """Return which raw parameters (parameter,) nothing depends on, such as one run to 0."""
        jacobian = problem.reported_jacobian(solution.raw)[: len(self.objective.layout.physical)]
        blind = self._blind(problem, solution, jacobian)
        alone = [names[0] for names in blind if len(names) == 1]
        still = np.flatnonzero(~jacobian.any(axis=1))
        alone += [self.objective.layout.physical[k] for k in still]
        return np.isin(self.objective.layout.raw_names, alone)

    def _ordered(
        self, problem: Problem, solution: Solution, jacobian: FloatArray
    ) -> tuple[Solution, ScoreSeries]:
        """Return a solution whose scores show how residuals vary: by window, else by sample."""
        series = ScoreSeries.of_windows(problem.windows)
        if series.ample:
            return solution, series
        given = solution.raw, problem.windows, solution.terms.starts
        scores = problem.objective.sample_scores(*given)[problem.moving]
        terms = replace(solution.terms, scores=scores)
        return replace(solution, terms=terms), ScoreSeries.of_samples(influence(terms, jacobian))

    def _report(self, rung: HorizonFit, place: tuple[int, int]) -> None:
        names = self.objective.layout.physical
        self.observer(
            {
                "event": "rung",
                "horizon": rung.horizon,
                "stage": place[0],
                "stages": place[1],
                "rmse": float(np.sqrt(rung.solution.terms.loss)),
                "rmse_unit": self._rmse_unit,
                "parameters": dict(zip(names, rung.values.tolist(), strict=False)),
                "std": dict(zip(names, rung.deviation.tolist(), strict=False)),
                "units": self.objective.layout.units,
                "evaluations": rung.solution.evaluations,
                "outcome": rung.solution.outcome,
            }
        )

    @property
    def _rmse_unit(self) -> str:
        """Unit of the root of the loss, where all residuals share one and are not scaled."""
        units, plain = set(measured_units(self.model).values()), np.all(self.objective.scale == 1)
        return units.pop() if plain and len(units) == 1 and not self.objective.loss.noise else ""

    def progress(self, horizon: int, place: tuple[int, int]) -> Callable[[FloatArray, float], None]:
        """Return what tells the observer of an evaluation, at a stage of so many."""
        names = self.objective.layout.physical

        def report(raw: FloatArray, loss: float) -> None:
            values = self.reported.values(raw)[: len(names)]
            self.observer(
                {
                    "event": "evaluation",
                    "horizon": horizon,
                    "stage": place[0],
                    "stages": place[1],
                    "loss": loss,
                    "rmse_unit": self._rmse_unit,
                    "parameters": dict(zip(names, values.tolist(), strict=True)),
                    "units": self.objective.layout.units,
                }
            )

        return report


def _together(names: Sequence[str]) -> str:
    """Return why parameters in one flat direction have no deviation."""
    if len(names) < 2:
        return (
            "no prediction depends on it in these recordings; record where it acts, or give it a "
            "prior"
        )
    return (
        f"{' and '.join(names)} act only together, and one makes up for the other; fix one, give "
        "it a prior, or measure what tells them apart"
    )


def strayed(rungs: Sequence[HorizonFit]) -> bool:
    """Return whether windows whose starts are estimated err much more the longer they are.

    A right model in its right minimum leaves the noise at every horizon.
    """
    last = rungs[-1].objective
    if last is None or not len(last.error.free):
        return False
    losses = [rung.solution.terms.loss for rung in rungs]
    return losses[-1] > _STRAYED * min(losses)


def _astray(problem: Problem, raw: FloatArray, before: Sequence[Solution]) -> bool:
    """Return whether raw (parameter,) may lead astray: windows err much more than shorter ones."""
    if not before[-1].converged:
        return True
    least = min(solution.terms.loss for solution in before)
    free = len(problem.objective.error.free)
    return bool(free and not problem.gauss_newton(raw).loss <= _STRAYED * least)
