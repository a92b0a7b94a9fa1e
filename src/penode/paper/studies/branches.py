"""Training that branches: what plans have in common is trained once.

A plan's stages follow each other, each from where the one before ended and with optimisers that
start anew. Two plans whose first stages are the same therefore pass through the same parameters
there: the paper's growth through short horizons is trained once a seed and every longer horizon
branches off, with the result that each would have had by itself.
"""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.fit.archive import to_json, write_atomically
from penode.fit.fit import Fit
from penode.horizon.assemble import Assembly
from penode.horizon.free_runs import with_free_runs
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, Observer
from penode.horizon.selection import Longest, choose
from penode.models.base import Model
from penode.training.plan import Plan, Stage


@dataclass(frozen=True, eq=False)
class Branches:
    """Where stages ended, kept in a JSON file: stages, as text, to the raw parameters after them.

    ``given`` is what they were trained with, as JSON can hold it; the ends are (parameter,).
    """

    path: Path
    given: Mapping[str, Any]
    ends: dict[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def at(cls, path: Path, given: Mapping[str, Any]) -> "Branches":
        """Read what is there; begin anew where it is damaged or was trained with other things."""
        try:
            document = json.loads(path.read_text())
            if document["given"] != given:
                return cls(path, given)
            ends = {key: np.array(raw, dtype=float) for key, raw in document["ends"].items()}
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return cls(path, given)
        return cls(path, given, ends)

    def keep(self, key: str, raw: FloatArray) -> None:
        """Add one end and write all."""
        self.ends[key] = raw
        ends = {name: end.tolist() for name, end in self.ends.items()}
        write_atomically(self.path, to_json({"given": self.given, "ends": ends}))


@dataclass(frozen=True, eq=False)
class Trainer:
    """Trains models of one structure on one recording, with the plan's solver, hold and loss."""

    problem: LadderProblem
    plan: Plan

    @classmethod
    def of(cls, model: Model, run: Experiment, plan: Plan, observer: Observer) -> "Trainer":
        """Return a trainer for a model's structure."""
        return cls(LadderProblem.of(model, [run], plan, observer), plan)

    def train(
        self, start: Model, plan: Plan, branches: Branches, validation: tuple[Experiment, ...]
    ) -> Fit:
        """Return the fit at the last stage of a plan; refuse it if that diverges.

        Stages whose ends ``branches`` knows are not trained again, and those passed on the way are
        added; the validation recordings are predicted only.
        """
        began = time.monotonic()
        *before, last = plan.stages
        raw = self._end(start, plan, tuple(before), branches)
        final = replace(plan, stages=(last,))
        climb = with_free_runs(self.problem, self.problem.climb(final, raw))
        branches.keep(_key(plan.stages), climb.fits[0].solution.raw)
        choice = choose(Longest(), climb, final)
        assembly = Assembly(self.problem, Start(start), final, climb.fits, choice)
        fit = assembly.fit(validation, began)
        if climb.interrupted:
            raise KeyboardInterrupt
        return fit

    def _end(
        self, start: Model, plan: Plan, stages: tuple[Stage, ...], branches: Branches
    ) -> FloatArray:
        """Return the raw parameters after stages, from as far as they are known."""
        if not stages:
            return self.problem.objective.layout.raw(start)
        key = _key(stages)
        if key not in branches.ends:
            raw = self._end(start, plan, stages[:-1], branches)
            problem = self.problem.problem(stages[-1], plan)
            solution = stages[-1].optimiser.minimise(problem, raw)
            branches.keep(key, solution.raw)
        return branches.ends[key]


def _key(stages: tuple[Stage, ...]) -> str:
    """Return stages as text, without addresses."""
    return " > ".join(f"{stage.horizon}:{_efforts(stage.optimiser)}" for stage in stages)


def _efforts(optimiser: Any) -> str:
    settings: Mapping[str, Any] = vars(optimiser)
    return ",".join(f"{k}={v}" for k, v in settings.items() if isinstance(v, (int, float)))
