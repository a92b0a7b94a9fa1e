"""Runs: everything that the studies train, once, each kept in a folder as it ends."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax

from penode.errors import InputError
from penode.fit.archive import to_json, write_atomically
from penode.fit.fit import Fit
from penode.fit.provenance import penode_version
from penode.horizon.ladder import Observer, ignore_events
from penode.models.base import Model
from penode.paper.conventional.method import Method
from penode.paper.studies.extent import Extent
from penode.paper.studies.measures import Measures, measure
from penode.paper.studies.our_defaults import OurDefaults
from penode.paper.studies.recordings import Case, fingerprint, record_case
from penode.paper.studies.trainer import Branches, Trainer
from penode.paper.studies.variants import Variant

#: Called with a line of progress.
Say = Callable[[str], None]


@dataclass(frozen=True)
class Run:
    """One finished training, or, without measures, the sentence with which the method refused.

    ``horizon`` is as asked for, 0 where the method chooses or has none. Times in s: what the
    horizons of one training have in common counts for the first of them.
    """

    recording: str
    method: str
    seed: int
    horizon: int
    measures: Measures | None
    refusal: str
    wall_time: float
    processor_time: float

    @property
    def result(self) -> Measures:
        """The measures of a run that was not refused."""
        if self.measures is None:
            raise InputError(f"{self.method} on {self.recording}: {self.refusal}")
        return self.measures


@dataclass(eq=False)
class Runs:
    """Trains what is not there yet and keeps it in ``RECORDING/METHOD/seedN/HN/`` of the folder.

    ``say`` is called with a line for each finished run, ``observer`` with each evaluation.
    """

    folder: Path
    extent: Extent
    say: Say
    observer: Observer = ignore_events
    _cases: dict[str, Case] = field(default_factory=dict)
    _trainers: dict[tuple[str, Variant], Trainer] = field(default_factory=dict)
    _runs: dict["Place", Run] = field(default_factory=dict)

    @property
    def spent(self) -> float:
        """Wall time in s of all runs asked for, those of earlier calls included."""
        return sum(run.wall_time for run in self._runs.values())

    def case(self, name: str) -> Case:
        """Return a recording, made at the first call."""
        if name not in self._cases:
            self.say(f"recording {name} ...")
            self._cases[name] = record_case(name, self.extent)
        return self._cases[name]

    def at_horizons(
        self, case: str, variant: Variant, horizons: Sequence[int], seeds: Sequence[int]
    ) -> list[Run]:
        """Return the runs of a variant, seed by seed and horizon by horizon."""
        return [run for seed in seeds for run in self._climbed(case, variant, horizons, seed)]

    def by_method(self, case: str, name: str, method: Method, settings: str = "") -> Run:
        """Return the run, in folder ``name``, of a method that chooses its horizon, or has none.

        ``case`` is a key of `CASES`; ``settings`` says what differs from call to call.
        """

        def train() -> Fit:
            made = self.case(case)
            return method.identify([made.experiment], made.validation, self.observer)

        return self._kept(Place(case, name), train, {"settings": settings})

    def fit(self, place: "Place") -> Fit:
        """Return the fit kept at a place, without its comparisons."""
        return Fit.load(self.folder / place.folder)

    def ours(self, case: str) -> Run:
        """Return the run of our defaults."""
        study = self.extent.ours
        return self.by_method(case, "ours", OurDefaults(study), str(study))

    def _climbed(
        self, case: str, variant: Variant, horizons: Sequence[int], seed: int
    ) -> list[Run]:
        settings = {"variant": str(replace(variant, label=""))}
        if variant.adam:
            size = self.extent
            settings["steps"] = f"{size.growth} {size.growth_steps} {size.steps}"

        @cache
        def begun() -> tuple[Model, Branches]:
            folder = self.folder / Path(case, variant.name, f"seed{seed}")
            given = self._given(case, settings)
            branches = Branches.at(folder / "branches.json", given)
            return variant.start(self.case(case).experiment, seed).model, branches

        def train(horizon: int) -> Fit:
            made, (start, branches) = self.case(case), begun()
            plan = variant.plans(horizons, made.experiment, seed, self.extent)[horizon]
            return self._trainer(case, variant).train(start, plan, branches, made.validation)

        climbing = variant.climbing and not variant.adam
        below = {h: [low for low in horizons if low <= h] if climbing else [] for h in horizons}
        return [
            self._kept(
                Place(case, variant.name, seed, h),
                partial(train, h),
                {**settings, "horizons": str(below[h])},
            )
            for h in horizons
        ]

    def _trainer(self, case: str, variant: Variant) -> Trainer:
        """Return the trainer of a variant's structure: optimiser and windows do not matter."""
        structure = replace(variant, name="", label="", jittered=False, climbing=True)
        key = (case, structure)
        if key not in self._trainers:
            if any(other != case for other, _ in self._trainers):
                # Compiled programs hold hundreds of megabytes, and are of one recording's use.
                self._trainers.clear()
                forget: Callable[[], None] = jax.clear_caches
                forget()
            run = self.case(case).experiment
            plan = structure.plans((1,), run, 0, self.extent)[1]
            start = structure.start(run, 0)
            plan = start.with_penalties(plan)
            self._trainers[key] = Trainer.of(start.model, run, plan, self.observer)
        return self._trainers[key]

    def _kept(
        self, place: "Place", train: Callable[[], Fit], settings: Mapping[str, str] | None = None
    ) -> Run:
        """Return the run kept at a place, or train and keep it.

        A run that was made in another way or on other recordings is made anew.
        """
        folder = self.folder / place.folder
        path, given = folder / "run.json", self._given(place.recording, settings or {})
        kept = _read(path, given)
        if kept is not None:
            self._runs[place] = kept
            return kept
        recording = self.case(place.recording).recording
        wall, processor = time.monotonic(), time.process_time()
        measures, refusal = None, ""
        try:
            fit = train()
            measures = measure(fit, recording)
            replace(fit, comparisons=()).save(folder)
        except InputError as error:
            refusal = str(error)
        spent = time.monotonic() - wall, time.process_time() - processor
        run = Run(
            **vars(place),
            measures=measures,
            refusal=refusal,
            wall_time=spent[0],
            processor_time=spent[1],
        )
        write_atomically(path, to_json({"given": given, **_plain(run)}))
        self.say(_line(run))
        self._runs[place] = run
        return run

    def _given(self, case: str, settings: Mapping[str, str]) -> dict[str, Any]:
        """Return what a kept run must have been made with."""
        size = self.extent
        return {
            "penode": penode_version(),
            "recordings": [size.share, size.unseen, size.unseen_duration],
            "simulation": fingerprint(case),
            **settings,
        }


@dataclass(frozen=True)
class Place:
    """Where a run belongs; see `Run`."""

    recording: str
    method: str
    seed: int = 0
    horizon: int = 0

    @property
    def folder(self) -> Path:
        """Below that of all runs."""
        return Path(self.recording, self.method, f"seed{self.seed}", f"H{self.horizon}")


def _plain(run: Run) -> dict[str, Any]:
    return {**vars(run), "measures": run.measures.plain() if run.measures else None}


def _read(path: Path, given: Mapping[str, Any]) -> Run | None:
    try:
        record = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict) or record.pop("given", None) != given:
        return None
    measures = record.pop("measures")
    return Run(**record, measures=Measures.restored(measures) if measures else None)


def _line(run: Run) -> str:
    at = f", H = {run.horizon}" if run.horizon else ""
    head = f"{run.recording}, {run.method}, seed {run.seed}{at}"
    if run.measures is None:
        return f"{head}: {run.refusal}"
    measures = run.measures
    return (
        f"{head}: R {1e3 * measures.resistance:.2f} mohm "
        f"(true {1e3 * measures.true_resistance:.2f}), "
        f"map {100 * measures.flux_share:.2f} %, {run.wall_time:.0f} s"
    )
