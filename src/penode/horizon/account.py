"""Account: a climbed ladder and the choice made on it, told as a `Fit`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from typing import Any

import numpy as np

from penode.arrays import BoolArray, FloatArray, float64
from penode.data.experiment import Experiment
from penode.horizon.consensus import Consensus, settled
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Ascent, RungFit
from penode.horizon.prefilter import linearised
from penode.horizon.selection import Choice
from penode.models.base import Model
from penode.training.covariance import sandwich
from penode.training.fit import Estimate, Fit, HorizonChoice, Rung, unused
from penode.training.learned_uncertainty import LearnedUncertainty
from penode.training.outcome import AVERAGED
from penode.training.plan import Plan, Problem
from penode.validation.coverage import thin
from penode.validation.free_run import Comparison, compare, free_run_rmse, with_unmeasured
from penode.validation.residual_tests import residual_correlations, residual_spectrum


@dataclass(frozen=True, eq=False)
class Account:
    """A climbed ladder and the choice made on it, to be told as a `Fit`.

    Attributes
    ----------
    ascent : Ascent
        Objective, recordings and reported quantities.
    start : Start
        Where training began and what the data could tell before it.
    plan : Plan
        What was to be climbed.
    rungs : sequence of RungFit
        Shortest horizon first.
    choice : Choice
        The selector's answer.
    found : tuple of str
        What cross-checks found, in sentences.
    """

    ascent: Ascent
    start: Start
    plan: Plan
    rungs: Sequence[RungFit]
    choice: Choice
    found: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the physical parameters."""
        return self.ascent.objective.layout.physical

    def fit(self, validation: Sequence[Experiment], provenance: Mapping[str, Any]) -> Fit:
        """Return the fit, every recording predicted by the selected model.

        Parameters
        ----------
        validation : sequence of Experiment
            Recordings that were not trained on.
        provenance : mapping
            Added to versions and data hashes.
        """
        predictor, experiments = self.ascent.objective.predictor, self.ascent.experiments
        chosen = self.rungs[self.choice.index]
        model = self._model(self._raw)
        own = [self._model(self._raw, k) for k in range(len(experiments))]
        seen = [compare(predictor, m, e, "train") for m, e in zip(own, experiments, strict=True)]
        comparisons = (*seen, *(compare(predictor, model, e, "validation") for e in validation))
        whole = [with_unmeasured(e, model) for e in experiments]
        visited = np.concatenate([e.stack(model.states) for e in whole])
        return Fit(
            model=model,
            parameters=self._estimates(),
            horizon=self._horizon(),
            excited=thin(visited),
            comparisons=comparisons,
            spectrum=residual_spectrum(comparisons[0]),
            transitions=self._transitions(own[0]),
            learned_uncertainty=self._uncertainty(chosen),
            correlations=residual_correlations(comparisons[0], whole[0], model.inputs),
            nuisances=self._nuisances(),
            warnings=self._warnings(comparisons),
            provenance={**_environment(experiments, validation), **provenance},
        )

    @cached_property
    def _consensus(self) -> Consensus:
        agreeing = [self.rungs[k] for k in self.choice.agreeing]
        if self.choice.verdict in AVERAGED:
            return Consensus.of(agreeing)
        return Consensus.around(self.rungs[self.choice.index], agreeing)

    @cached_property
    def _raw(self) -> FloatArray:
        """The raw parameters reported, shape (parameter,)."""
        chosen, ascent = self.rungs[self.choice.index], self.ascent
        problem = Problem(ascent.objective, ascent.reported, chosen.windows, self._moving)
        return settled(problem, chosen, self._consensus.values)

    @property
    def _moving(self) -> BoolArray:
        stage = self.plan.stages[self.choice.index]
        return self.ascent.objective.layout.members(stage.groups)

    def _model(self, raw: FloatArray, experiment: int | None = None) -> Model:
        with float64():
            model: Model = self.ascent.objective.layout.plain_model(raw, experiment)
        return model

    def _transitions(self, model: Model) -> FloatArray:
        objective = self.ascent.objective
        if not objective.error.is_filtered_one_step:
            return np.empty((0, 0, 0))
        recording = self.ascent.experiments[0]
        return linearised(objective.predictor, model, recording, objective.scale)

    def _uncertainty(self, chosen: RungFit) -> LearnedUncertainty:
        layout = self.ascent.objective.layout
        moving = np.flatnonzero(self._moving)
        known = np.isfinite(chosen.deviation[len(self.names) :]).all()
        covariance = np.full((layout.size, layout.size), np.inf)
        if known:
            covariance[:] = 0.0
            covariance[np.ix_(moving, moving)] = sandwich(chosen.solution.terms, chosen.windows)
        agreeing = [self.rungs[k] for k in self.choice.agreeing]
        physical, kept = len(self.names), layout.first_copies
        squares = np.array([np.sum(rung.working[physical:] ** 2) for rung in agreeing])
        precision = 1 / np.maximum(squares, 1e-300)
        return LearnedUncertainty(
            covariance=covariance[np.ix_(kept, kept)],
            agreeing=np.stack([rung.solution.raw[kept] for rung in agreeing]),
            weights=precision / precision.sum(),
        )

    def _nuisances(self) -> dict[str, FloatArray]:
        with float64():
            return self.ascent.objective.layout.nuisances(self._raw)

    def _estimates(self) -> dict[str, Estimate]:
        layout, found = self.ascent.objective.layout, self._consensus
        estimates = {}
        for k, name in enumerate(self.names):
            value, std = float(found.values[k]), float(found.deviation[k])
            unit = layout.settings[layout.names.index(name)].unit
            interval = (value - 1.96 * std, value + 1.96 * std)
            rho = self.start.identifiability.get(name)
            estimates[name] = Estimate(value, std, interval, unit, rho)
        return estimates

    def _horizon(self) -> HorizonChoice:
        verdict, reason = self.choice.verdict, self.choice.reason
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

    def _ladder(self) -> tuple[Rung, ...]:
        experiments = self.ascent.experiments
        fits = [
            [self._model(r.solution.raw, k) for k in range(len(experiments))] for r in self.rungs
        ]
        errors = free_run_rmse(self.ascent.objective.predictor, fits, experiments)
        return tuple(
            Rung(
                horizon=rung.horizon,
                parameters=dict(zip(self.names, rung.values.tolist(), strict=False)),
                std=dict(zip(self.names, rung.deviation.tolist(), strict=False)),
                rmse=float(np.sqrt(rung.solution.terms.loss)),
                free_run_rmse=float(error) if np.isfinite(error) else None,
                iterations=rung.solution.evaluations,
                outcome=rung.solution.outcome,
            )
            for rung, error in zip(self.rungs, errors, strict=True)
        )

    def _warnings(self, comparisons: Sequence[Comparison]) -> tuple[str, ...]:
        found = [
            f"{c.name}: the free run diverges; the map is unusable for simulation there."
            for c in comparisons
            if not np.isfinite(c.free_run_rmse)
        ]
        found += self.found
        if len(self.rungs) < len(self.plan.stages):
            found.append(self._shortfall())
        hidden = self.start.indistinguishable
        if hidden:
            found.insert(0, f"{_hidden(self.start, hidden)} {self.start.repair}")
        return tuple(found)

    def _shortfall(self) -> str:
        reached, top = self.rungs[-1].horizon, self.plan.stages[-1].horizon
        if self.choice.verdict == "stopped":
            return f"Stopped after horizon {reached} of {top}; longer ones were not tried."
        horizon = self.plan.stages[len(self.rungs)].horizon
        return f"The predictions diverge at horizon {horizon}; longer ones were not tried."


def stopped(choice: Choice, plan: Plan) -> Choice:
    """Return the choice among the first rungs of a plan that a person stopped.

    Parameters
    ----------
    choice : Choice
        The selector's, among the finished rungs.
    plan : Plan
        What was to be climbed.
    """
    reason = f"The ladder was not climbed to its end. So far: {choice.reason}"
    if choice.verdict == "fixed":
        reason = f"The horizon asked for, {plan.stages[-1].horizon}, was not reached."
    return replace(choice, verdict="stopped", reason=reason)


def _hidden(start: Start, names: Sequence[str]) -> str:
    shares = ", ".join(f"{n} ({start.identifiability[n]:.1e} of it is its own)" for n in names)
    return f"These data cannot tell {shares} from the learned map."


def _environment(
    experiments: Sequence[Experiment], validation: Sequence[Experiment]
) -> dict[str, Any]:
    data: dict[str, str] = {}
    for experiment in (*experiments, *validation):
        data[unused(experiment.name, data)] = experiment.source.sha256
    return {
        "versions": {name: version(name) for name in ("penode", "jax", "numpy", "scipy")},
        "data": data,
    }
