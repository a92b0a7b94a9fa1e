"""Checkpoint: start and finished rungs of a climb in one file, from which a stopped fit goes on."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import jax
import numpy as np

from penode.arrays import FloatArray, float64
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.fit.provenance import penode_version
from penode.horizon.checkpoint_file import Record, Rung, packed, read, text
from penode.horizon.ladder import Observer
from penode.training.plan import (
    DIVERGED,
    Optimiser,
    Plan,
    Problem,
    Progress,
    Solution,
    ignore_progress,
)

#: Starts that differ by less, relative to the largest entry, are one start where none is kept:
#: another processor rounds otherwise, and only the first rung, which is finished, began there.
_SAME_START = 1e-6

#: Longer descriptions are not put into a sentence.
_LEGIBLE = 60


@dataclass(frozen=True)
class Checkpoint:
    """A file that keeps what a climb began with, and its finished rungs.

    Attributes
    ----------
    path : Path
        A JSON file; replaced in one step after every rung.
    resume : bool
        Whether finished rungs in the file are taken over. Otherwise the climb begins at its first
        rung, and the file of an earlier one stays until that rung is finished.
    """

    path: Path
    resume: bool = False

    def begun(self, asked: Mapping[str, object]) -> Any:
        """Return what the climb in the file began with, or None where there is nothing to resume.

        To compute it anew would give other last digits, and with them another climb.

        Parameters
        ----------
        asked : mapping of str to object
            What was asked for, by the name that a refusal gives it.

        Raises
        ------
        InputError
            If the file cannot be read, is damaged, or something else was asked for there.
        """
        record = read(Path(self.path)) if self.resume else None
        if record is None:
            return None
        _require_same(Path(self.path), record.asked, _words(asked))
        return record.restored(Path(self.path))

    def over(
        self,
        plan: Plan,
        observer: Observer,
        asked: Mapping[str, object] = MappingProxyType({}),
        began: object = None,
    ) -> Plan:
        """Return the plan with every rung kept as it is finished, and kept rungs taken over.

        A rung taken over costs one evaluation and comes out as it was, to the last digit. What a
        function without a readable name does cannot be compared, such as the learning rate inside
        an optax transformation.

        Parameters
        ----------
        plan : Plan
        observer : callable
            Receives the horizons taken over.
        asked : mapping of str to object
            As in `begun`.
        began : object
            What `begun` is to return: models, records, mappings, tuples, arrays, numbers and text.

        Raises
        ------
        InputError
            If the file cannot be read, is damaged, or belongs to another plan; while training, if
            it belongs to other recordings, another model or another start.
        """
        path, given = Path(self.path), _given_by_plan(plan)
        record = Record(_words(asked), given, np.zeros(0), packed(began))
        if self.resume:
            record = read(path) or record
            _require_same(path, record.given, given)
            observer({"event": "resume", "horizons": [rung.horizon for rung in record.rungs]})
        journal = _Journal(path, record)
        stages = [
            replace(stage, optimiser=_Kept(stage.optimiser, stage.horizon, number, journal))
            for number, stage in enumerate(plan.stages)
        ]
        return replace(plan, stages=tuple(stages))


class _Journal:
    """The record of one climb as it goes."""

    def __init__(self, path: Path, record: Record):
        self._path = path
        self._record = record

    def recognise(self, problem: Problem, raw: FloatArray) -> None:
        """Begin the record, or refuse the file's if it belongs to another climb."""
        given = {**self._record.given, **_given_by_problem(problem, raw)}
        if not self._record.rungs:
            self._record = replace(self._record, given=given, start=raw)
            return
        _require_same(self._path, self._record.given, given)
        if self._record.began["tree"] is not None:
            return  # the start came out of the file
        gap = np.abs(self._record.start - raw).max(initial=0.0)
        if gap > _SAME_START * np.abs(raw).max(initial=1.0):
            raise _refusal(self._path, "start")

    def rung(self, number: int) -> Rung | None:
        """Return a finished rung, or None if it is still to be climbed."""
        rungs = self._record.rungs
        return rungs[number] if number < len(rungs) else None

    def keep(self, rung: Rung) -> None:
        """Write the record with one more rung."""
        self._record = replace(self._record, rungs=(*self._record.rungs, rung))
        try:
            write_atomically(self._path, text(self._record))
        except OSError as error:
            raise InputError(
                f"{self._path}: the checkpoint cannot be written ({error.strerror or error}); "
                "make room there, or give another folder."
            ) from error


@dataclass(frozen=True, eq=False)
class _Kept:
    """An optimiser whose solution is kept, or taken over where it was kept before."""

    optimiser: Optimiser
    horizon: int
    number: int
    journal: _Journal

    def minimise(
        self, problem: Problem, raw: FloatArray, progress: Progress = ignore_progress
    ) -> Solution:
        """Return the kept solution, or the optimiser's."""
        if self.number == 0:
            self.journal.recognise(problem, raw)
        kept = self.journal.rung(self.number)
        if kept is not None:
            terms = problem.gauss_newton(kept.raw)
            return Solution(kept.raw, terms, kept.evaluations, kept.outcome)
        solution = self.optimiser.minimise(problem, raw, progress)
        if solution.outcome != DIVERGED:
            self.journal.keep(
                Rung(self.horizon, solution.raw, solution.evaluations, solution.outcome)
            )
        return solution


def _words(asked: Mapping[str, object]) -> dict[str, str]:
    return {name: _readable(value) for name, value in asked.items()}


def _given_by_plan(plan: Plan) -> dict[str, str]:
    return {
        "penode version": penode_version(),
        "horizons": ", ".join(str(stage.horizon) for stage in plan.stages),
        "moving groups": _readable([stage.groups for stage in plan.stages]),
        "optimisers": _readable([stage.optimiser for stage in plan.stages]),
        "window placement": _readable(plan.placement),
        "solver": _readable(plan.solver),
        "hold": _readable(plan.hold),
        "loss": _readable(plan.loss),
    }


def _given_by_problem(problem: Problem, raw: FloatArray) -> dict[str, str]:
    windows, layout = problem.windows, problem.objective.layout
    digest = hashlib.sha256(f"{windows.time_step!r} {windows.states.shape}".encode())
    if windows.time_steps is not None:
        digest.update(windows.time_steps.tobytes())
    for array in (windows.measured, windows.inputs, windows.starts, windows.recording):
        digest.update(np.ascontiguousarray(array).tobytes())
    with float64():
        leaves, structure = jax.tree.flatten(layout.plain_model(raw))
    shapes = [leaf.shape for leaf in leaves]
    return {
        "recordings": digest.hexdigest(),
        "model": f"{_readable(structure)} {layout.names} {shapes} {layout.experiments}",
    }


def _readable(thing: object) -> str:
    """Return the representation without addresses, numbers rounded as another processor would."""
    text = re.sub(r" at 0x[0-9a-f]+", "", repr(thing))
    return re.sub(r"\d+\.\d+(e[-+]?\d+)?", lambda match: f"{float(match[0]):.9g}", text)


def _require_same(path: Path, saved: Mapping[str, str], given: Mapping[str, str]) -> None:
    for name, now in given.items():
        before = saved.get(name, now)  # the earlier schema has fewer names
        if before == now:
            continue
        if max(len(before), len(now)) <= _LEGIBLE:
            raise _refusal(path, f"{name} ({before} there, {now} here)")
        raise _refusal(path, name)


def _refusal(path: Path, difference: str) -> InputError:
    return InputError(
        f"{path}: the stopped fit differs in its {difference}; give what it was given, or begin "
        "again without resuming."
    )
