"""Assembly: a climbed ladder and the choice made on it become a `Fit`."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from penode.arrays import BoolArray, FloatArray, float64
from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.fit.fit import Estimate, Fit, HorizonChoice, HorizonSummary
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.fit.outcome import AGREED, Contribution
from penode.fit.provenance import provenance_of
from penode.horizon.consensus import (
    BESIDE,
    DECLARED,
    LEFT_OUT,
    PRIOR,
    Consensus,
    averaged,
    map_weights,
    retrained,
)
from penode.horizon.cross_checks import CrossCheck
from penode.horizon.discrepancy import what_is_left_out
from penode.horizon.identifiability import Start
from penode.horizon.initial_states import initial_states
from penode.horizon.ladder import HorizonFit, LadderProblem
from penode.horizon.loss_weighting import linearised
from penode.horizon.selection import Choice
from penode.horizon.simulation import best_in_free_run, better_by_chance, parting
from penode.horizon.steady import compared_at_rest
from penode.horizon.uncertainty_budget import Imperfection, budget, raw_shifts
from penode.models.base import Model
from penode.models.measured import hidden_states, measured_units
from penode.training.covariance import sandwich
from penode.training.plan import Plan, Problem
from penode.validation.comparison import Comparison
from penode.validation.coverage import thin
from penode.validation.free_run import compare, with_unmeasured
from penode.validation.residual_tests import residual_correlations, residual_spectrum

_UNCHECKED = CrossCheck()
_UNFINISHED = (
    "Stopped during the cross-check; whether the estimate depends on the path of training is open."
)
_NOT_LOOKED_FOR = (
    "States and inputs are too many to look for what the model leaves out, so intervals may be too "
    "narrow; compare with a model of fewer states."
)


@dataclass(frozen=True, eq=False)
class Assembly:
    """A climbed ladder and the choice made on it, of which a `Fit` is made."""

    problem: LadderProblem
    start: Start
    plan: Plan
    rungs: Sequence[HorizonFit]
    choice: Choice
    check: CrossCheck = _UNCHECKED

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the physical parameters."""
        return self.problem.objective.layout.physical

    def fit(self, validation: Sequence[Experiment], began: float) -> Fit:
        """Return the fit, every recording predicted; `began` is of ``time.monotonic``, s."""
        provenance = {
            **provenance_of((*self.problem.experiments, *validation)),
            "training_time_s": time.monotonic() - began,
            "placement": str(self.plan.placement),
            "solver": str(self.plan.solver),
            "hold": str(self.plan.hold),
            **self.start.facts,
        }
        predictor, experiments = self.problem.objective.predictor, self.problem.experiments
        model = self._model(self._raw)
        own, seen = self._seen(self._raw)
        unseen = (compare(predictor.at(e.time_step), model, e, "validation") for e in validation)
        comparisons = (*seen, *unseen)
        whole = [with_unmeasured(e, model) for e in experiments]
        visited = np.concatenate([e.stack(model.states) for e in self._visited])
        fastest = [e for e in experiments if predictor.at(e.time_step) is predictor]
        shown = experiments.index(max(by_recording(fastest)[0], key=len))
        return Fit(
            model=model,
            parameters=self._estimates(),
            horizon=self._horizon(),
            excited=thin(visited),
            comparisons=comparisons,
            spectrum=residual_spectrum(comparisons[shown]),
            transitions=self._transitions(own[shown], experiments[shown]),
            starts=self._starts,
            learned_uncertainty=self._uncertainty(),
            initial_states=initial_states(self.problem, self._raw, self._covariance, seen),
            covariance=self._joint,
            stationary=compared_at_rest(
                self.start, self.problem, self.rungs[self.choice.index], self._raw, self._moving
            ),
            correlations=residual_correlations(comparisons[shown], whole[shown], model.inputs),
            nuisances=self._nuisances(),
            simulation=self._simulation(model, seen),
            predictor=predictor,
            warnings=self._warnings(comparisons),
            provenance=provenance,
        )

    def _seen(self, raw: FloatArray) -> tuple[list[Model], list[Comparison]]:
        """Return the models of the recordings, and each of these beside its predictions."""
        predictor, experiments = self.problem.objective.predictor, self.problem.experiments
        own = [self._model(raw, k) for k in range(len(experiments))]
        pairs = zip(own, experiments, strict=True)
        return own, [compare(predictor.at(e.time_step), m, e, "train") for m, e in pairs]

    def _simulation(self, model: Model, seen: Sequence[Comparison]) -> Model:
        """Return the model to simulate with: another's only where it is better beyond chance."""
        best = best_in_free_run(self.rungs)
        raw = self.rungs[best].solution.raw
        agreed = self.choice.verdict in AGREED and not parting(self.choice, self.rungs)
        past = self.problem.objective.predictor.past
        if agreed and (
            best == self.choice.index or better_by_chance(self._seen(raw)[1], seen, past)
        ):
            return model
        return self._model(raw)

    @property
    def _visited(self) -> list[Experiment]:
        """The recordings with the hidden states that the chosen rung's windows find."""
        problem, chosen = self.problem, self.rungs[self.choice.index]
        found: Sequence[Mapping[str, FloatArray]] = [{}] * len(problem.experiments)
        if hidden_states(problem.model):
            objective = chosen.objective or problem.objective
            found = problem.hidden_states(objective, chosen.solution, chosen.windows)
        return [
            with_unmeasured(replace(e, channels={**e.channels, **own}), problem.model)
            for e, own in zip(problem.experiments, found, strict=True)
        ]

    @cached_property
    def _consensus(self) -> Consensus:
        return Consensus.reported(self.choice, self.rungs)

    @cached_property
    def _raw(self) -> FloatArray:
        """The raw parameters reported, shape (parameter,)."""
        chosen, problem, values = (
            self.rungs[self.choice.index],
            self.problem,
            self._consensus.values,
        )
        objective = chosen.objective or problem.objective
        again = Problem(objective, problem.reported, chosen.windows, self._moving)
        layout = problem.objective.layout
        others = self._moving & ~layout.physical_members
        linear = others.any() and layout.linear_members[others].all()
        if self._consensus.mean and linear:
            return averaged(again, chosen, self._agreeing, values)
        return retrained(again, chosen, values)

    @property
    def _agreeing(self) -> list[HorizonFit]:
        return [self.rungs[k] for k in self.choice.agreeing]

    @property
    def _moving(self) -> BoolArray:
        stage = self.plan.stages[self.choice.index]
        return self.problem.objective.layout.members(stage.groups)

    def _model(self, raw: FloatArray, experiment: int | None = None) -> Model:
        with float64():
            model: Model = self.problem.objective.layout.plain_model(raw, experiment)
        return model

    def _transitions(self, model: Model, recording: Experiment) -> FloatArray:
        objective = self.problem.objective
        if not objective.error.is_filtered_one_step:
            return np.empty((0, 0, 0))
        return linearised(objective.predictor, model, recording, objective.scale)

    @property
    def _starts(self) -> FloatArray:
        error = self.problem.objective.error
        return error.start_stiffness if error.is_filtered_one_step else np.empty(0)

    @cached_property
    def _shifts(self) -> FloatArray:
        """What each imperfection moves the raw parameters by, shape (imperfection, parameter)."""
        k, plan = self.choice.index, self.plan
        return raw_shifts(self.problem, plan, plan.stages[k], self.rungs[k], self._imperfections)

    @cached_property
    def _imperfections(self) -> tuple[Imperfection, ...]:
        """Those of the recordings, and for what the model of the chosen rung leaves out."""
        if self.start.left_out is None:
            return self.start.imperfections
        chosen = self._model(self.rungs[self.choice.index].solution.raw)
        return (*self.start.imperfections, *self.start.left_out(chosen))

    @cached_property
    def _covariance(self) -> FloatArray:
        """Covariance of the raw parameters, infinite where the learned part's is not known."""
        chosen, layout = self.rungs[self.choice.index], self.problem.objective.layout
        moving = np.flatnonzero(self._moving)
        finite = np.isfinite(chosen.deviation[len(self.names) :]).all()
        covariance = np.full((layout.size, layout.size), np.inf)
        if finite:
            covariance[:] = self._shifts.T @ self._shifts
            covariance[np.ix_(moving, moving)] += sandwich(chosen.solution.terms, chosen.series)
        return covariance

    def _uncertainty(self) -> LearnedUncertainty:
        kept = self.problem.objective.layout.first_copies
        return LearnedUncertainty(
            covariance=self._covariance[np.ix_(kept, kept)],
            agreeing=np.stack([rung.solution.raw[kept] for rung in self._agreeing]),
            weights=map_weights(self._agreeing),
            shifts={
                one.source: shift[kept]
                for one, shift in zip(self._imperfections, self._shifts, strict=True)
            },
        )

    def _nuisances(self) -> dict[str, FloatArray]:
        with float64():
            return self.problem.objective.layout.nuisances(self._raw)

    def _estimates(self) -> dict[str, Estimate]:
        layout, together = self.problem.objective.layout, self._consensus
        settings = dict(zip(layout.names, layout.settings, strict=True))
        budgets = self._budgets
        return {
            name: Estimate.of(
                float(together.values[k]),
                float(np.sqrt(sum(row.std**2 for row in budgets[k]))),
                settings[name].unit,
                self.start.identifiability.get(name),
                settings[name].meaning,
                budgets[k],
            )
            for k, name in enumerate(self.names)
        }

    @cached_property
    def _parts(self) -> Mapping[str, FloatArray]:
        """What the data show of the physical parameters' covariance, by source."""
        parts = dict(self._consensus.parts)
        if PRIOR in parts:
            parts[self._prior_row] = parts.pop(PRIOR)
        if self.plan.discrepancy:
            chosen = self.choice.index
            found = what_is_left_out(self.problem, self.plan, self.rungs, chosen)
            if found is not None:
                parts[LEFT_OUT] = found
        return parts

    @property
    def _prior_row(self) -> str:
        """What the budget calls what is known beside the recordings."""
        if self.start.points is not None:
            return BESIDE
        declared = any(setting.prior for setting in self.problem.objective.layout.settings)
        return DECLARED if declared else PRIOR

    @cached_property
    def _moved(self) -> FloatArray:
        """What each imperfection moves the physical parameters by, (imperfection, physical)."""
        chosen = self.rungs[self.choice.index]
        slopes = self.problem.reported.jacobian(chosen.solution.raw)[: len(self.names)]
        return np.nan_to_num(self._shifts @ slopes.T, nan=np.inf)

    @property
    def _joint(self) -> FloatArray:
        """Covariance of the physical parameters as reported, (physical, physical), SI units."""
        with np.errstate(invalid="ignore"):
            return np.asarray(sum(self._parts.values()) + self._moved.T @ self._moved)

    @cached_property
    def _budgets(self) -> list[tuple[Contribution, ...]]:
        """Return the uncertainty budget of every physical parameter."""
        shown = {source: np.sqrt(np.diag(part)) for source, part in self._parts.items()}
        return [
            budget(
                {source: float(part[k]) for source, part in shown.items()},
                self._imperfections,
                self._moved[:, k],
            )
            for k in range(len(self.names))
        ]

    def _horizon(self) -> HorizonChoice:
        verdict, reason = self.choice.verdict, self.choice.reason
        if self.check.interrupted:
            verdict = "stopped"
            reason = f"The cross-check of the horizon was interrupted. Before it: {reason}"
        hidden = self.start.indistinguishable
        if hidden:
            verdict = "not identifiable"
            reason = f"{_hidden(self.start, hidden)} {self.start.repair}"
        return HorizonChoice(
            selected=self.rungs[self.choice.index].horizon,
            verdict=verdict,
            reason=reason,
            ladder=self._ladder(),
            plateau=tuple(self.rungs[k].horizon for k in self.choice.agreeing),
        )

    def _ladder(self) -> tuple[HorizonSummary, ...]:
        model = self.problem.model
        errors = np.stack([np.asarray(rung.free_run, dtype=float) for rung in self.rungs])
        measured = measured_units(model)
        pooled = np.sqrt(np.mean(errors**2, axis=1))
        if len(set(measured.values())) > 1:
            pooled[:] = np.nan
        return tuple(
            HorizonSummary(
                horizon=rung.horizon,
                parameters=dict(zip(self.names, rung.values.tolist(), strict=False)),
                std=dict(zip(self.names, rung.deviation.tolist(), strict=False)),
                rmse=float(np.sqrt(rung.solution.terms.loss)),
                free_run_rmse=_if_finite(together),
                iterations=rung.solution.evaluations,
                outcome=rung.solution.outcome,
                free_run_errors=dict(zip(measured, map(_if_finite, each), strict=True)),
            )
            for rung, together, each in zip(self.rungs, pooled, errors, strict=True)
        )

    def _warnings(self, comparisons: Sequence[Comparison]) -> tuple[str, ...]:
        warnings = [
            f"{c.name}: the free run diverges; the map is unusable for simulation there."
            for c in comparisons
            if c.diverged
        ]
        warnings += self._unknown()
        warnings += self._left_out()
        if self.plan.discrepancy and LEFT_OUT not in self._parts:
            warnings.append(_NOT_LOOKED_FOR)
        warnings += self.check.contradictions
        if self.check.interrupted:
            warnings.append(_UNFINISHED)
        if len(self.rungs) < len(self.plan.stages):
            warnings.append(self._shortfall())
        hidden = self.start.indistinguishable
        if hidden:
            warnings.insert(0, f"{_hidden(self.start, hidden)} {self.start.repair}")
        return (*warnings, *self.start.warnings)

    def _unknown(self) -> Iterator[str]:
        """Yield why intervals are infinite, a sentence for each reason."""
        named: dict[str, list[str]] = {}
        for k, name in enumerate(self.names):
            reasons = [rung.reasons[k] for rung in self._agreeing if rung.reasons]
            if not np.isfinite(self._consensus.deviation[k]) and any(reasons):
                named.setdefault(next(filter(None, reasons)), []).append(name)
        for reason, names in named.items():
            yield f"The interval of {', '.join(names)} is infinite: {reason}."

    def _left_out(self) -> Iterator[str]:
        """Yield of which parameters most of the variance is of what the model leaves out."""
        named: dict[tuple[str, str], list[str]] = {}
        for name, rows in zip(self.names, self._budgets, strict=True):
            whole = sum(row.std**2 for row in rows)
            for row in rows:
                if row.source == LEFT_OUT and np.isfinite(whole) and row.std**2 > 0.5 * whole:
                    named.setdefault((row.accuracy, row.remedy), []).append(name)
        for (accuracy, remedy), names in named.items():
            size = f" ({accuracy})" if accuracy else ""
            what = f"is what the model leaves out{size}, which is counted in the interval"
            yield f"Most of the uncertainty of {', '.join(names)} {what}. {remedy}"

    def _shortfall(self) -> str:
        reached, top = self.rungs[-1].horizon, self.plan.stages[-1].horizon
        if self.choice.verdict == "stopped":
            return f"Stopped after horizon {reached} of {top}; longer ones were not tried."
        horizon = self.plan.stages[len(self.rungs)].horizon
        return f"The predictions diverge at horizon {horizon}; longer ones were not tried."


def _hidden(start: Start, names: Sequence[str]) -> str:
    listed = ", ".join(f"{n} ({start.identifiability[n]:.1e} of it is its own)" for n in names)
    return f"These data cannot distinguish {listed} from the learned map."


def _if_finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
