"""Training that branches: what plans have in common is trained once.

A plan's stages follow each other, each from where the one before ended and with optimisers that
start anew. Two plans whose first stages are the same therefore pass through the same parameters
there: the paper's growth through short horizons is trained once a seed and every longer horizon
branches off, with the result that each would have had by itself.
"""

import json
import time
from collections.abc import Mapping, Sequence
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
from penode.horizon.ladder import LadderProblem
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
            known = document["ends"] if document["given"] == given else {}
            ends = {key: np.array(raw, dtype=float) for key, raw in known.items()}
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            ends = {}
        return cls(path, given, ends)

    def train(
        self, problem: LadderProblem, start: Model, plan: Plan, validation: Sequence[Experiment]
    ) -> Fit:
        """Return the fit at the last stage of a plan; refuse it if that diverges.

        Solver, hold and loss are the problem's. Stages whose ends are known are not trained again,
        and those passed on the way are added; the validation recordings are predicted only.
        """
        began = time.monotonic()
        raw = self._end(problem, start, plan, plan.stages[:-1])
        final = replace(plan, stages=plan.stages[-1:])
        climb = with_free_runs(problem, problem.climb(final, raw))
        self.keep(_key(plan.stages), climb.fits[0].solution.raw)
        choice = choose(Longest(), climb, final)
        fit = Assembly(problem, Start(start), final, climb.fits, choice).fit(validation, began)
        if climb.interrupted:
            raise KeyboardInterrupt
        return fit

    def _end(
        self, problem: LadderProblem, start: Model, plan: Plan, stages: tuple[Stage, ...]
    ) -> FloatArray:
        """Return the raw parameters after stages, from as far as they are known."""
        if not stages:
            return problem.objective.layout.raw(start)
        key = _key(stages)
        if key not in self.ends:
            raw = self._end(problem, start, plan, stages[:-1])
            solution = stages[-1].optimiser.minimise(problem.problem(stages[-1], plan), raw)
            self.keep(key, solution.raw)
        return self.ends[key]

    def keep(self, key: str, raw: FloatArray) -> None:
        """Add one end and write all."""
        self.ends[key] = raw
        ends = {name: end.tolist() for name, end in self.ends.items()}
        write_atomically(self.path, to_json({"given": self.given, "ends": ends}))


def _key(stages: Sequence[Stage]) -> str:
    """Return stages as text, without addresses."""
    return " > ".join(f"{stage.horizon}:{_efforts(stage.optimiser)}" for stage in stages)


def _efforts(optimiser: Any) -> str:
    settings: Mapping[str, Any] = vars(optimiser)
    return ",".join(f"{k}={v}" for k, v in settings.items() if isinstance(v, (int, float)))
