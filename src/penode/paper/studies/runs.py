"""Runs: everything that the studies train, once, each kept in a folder as it ends."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeAlias

import jax
import numpy as np

from penode.bench.run import Recording
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.archive import to_json, write_atomically
from penode.fit.fit import Fit
from penode.fit.provenance import penode_version
from penode.horizon.ladder import LadderProblem, Observer, ignore_events
from penode.models.base import Model
from penode.paper.studies.branches import Branches
from penode.paper.studies.recordings import Case, fingerprint, record_case
from penode.paper.studies.variants import Extent, Variant
from penode.pmsm.study import identify

#: Called with a line of progress.
Say: TypeAlias = Callable[[str], None]

#: Takes recordings to learn from, others to predict only, and an observer.
Method: TypeAlias = Callable[[Sequence[Experiment], Sequence[Experiment], Observer], Fit]

#: Points a side of the grid on which maps are compared.
_GRID = 61


@dataclass(frozen=True)
class Measures:
    """How good a fit is, in SI units; a one-step or free-run error is infinite after a divergence.

    ``flux_mae`` is the mean absolute error of psi_d and psi_q over the excited region in Vs,
    ``trained`` the RMSE in A over the horizon (steps) on the windows trained on; one-step errors
    are mean squares in A^2, free-run errors RMSE in A, by unseen recording; ``magnet_flux`` is the
    data sheet's.
    """

    resistance: float
    deviation: float
    true_resistance: float
    horizon: int
    verdict: str
    flux_mae: float
    magnet_flux: float
    trained: float
    one_step_train: float
    one_step: Mapping[str, float]
    free_run: Mapping[str, float]
    others: Mapping[str, float]

    @property
    def error(self) -> float:
        """Relative error of R."""
        return self.resistance / self.true_resistance - 1

    @property
    def flux_share(self) -> float:
        """Error of the map over psi_PM."""
        return self.flux_mae / self.magnet_flux

    @property
    def unseen_one_step(self) -> float:
        """Mean of the one-step errors over the unseen recordings, in A^2."""
        return float(np.mean(list(self.one_step.values()))) if self.one_step else np.nan

    @property
    def unseen_free_run(self) -> float:
        """Median of the free-run errors over the unseen recordings, in A."""
        return float(np.median(list(self.free_run.values()))) if self.free_run else np.nan

    @classmethod
    def restored(cls, record: Mapping[str, Any]) -> "Measures":
        """Return measures from JSON; a number that was not finite is infinite."""

        def finite(value: Any) -> Any:
            if isinstance(value, Mapping):
                return {name: finite(inner) for name, inner in value.items()}
            return np.inf if value is None else value

        return cls(**finite(record))


def measure(fit: Fit, recording: Recording) -> Measures:
    """Measure a fit, with comparisons, beside the truth of the bench that it never saw."""
    truth = recording.truth
    limit = np.abs(fit.excited).max()
    axis = np.linspace(-limit, limit, _GRID)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    points = points[fit.supported(points)]
    gap = fit.flux_map(*points.T).T - truth.flux_map(*points.T)
    seen = [c for c in fit.comparisons if c.role == "train"]
    unseen = [c for c in fit.comparisons if c.role != "train"]
    rungs = {rung.horizon: rung.rmse for rung in fit.horizon.ladder}
    return Measures(
        resistance=fit.parameters["R"].value,
        deviation=fit.parameters["R"].std,
        true_resistance=truth.resistance,
        horizon=fit.horizon.selected,
        verdict=fit.horizon.verdict,
        flux_mae=float(np.mean(np.abs(gap))),
        magnet_flux=truth.machine.magnet_flux_linkage,
        trained=rungs[fit.horizon.selected],
        one_step_train=float(np.mean([c.one_step_rmse**2 for c in seen])),
        one_step={c.name: c.one_step_rmse**2 for c in unseen},
        free_run={c.name: c.free_run_rmse for c in unseen},
        others={name: p.value for name, p in fit.parameters.items() if name != "R"},
    )


@dataclass(frozen=True)
class Place:
    """Where a run belongs; ``horizon`` is as asked for, 0 where the method chooses or has none."""

    recording: str
    method: str
    seed: int = 0
    horizon: int = 0

    @property
    def folder(self) -> Path:
        """Below that of all runs."""
        return Path(self.recording, self.method, f"seed{self.seed}", f"H{self.horizon}")


@dataclass(frozen=True)
class Run(Place):
    """One finished training, or, without measures, the sentence with which the method refused.

    Times in s: what the horizons of one training have in common counts for the first of them.
    """

    measures: Measures | None = None
    refusal: str = ""
    wall_time: float = 0.0
    processor_time: float = 0.0

    @property
    def result(self) -> Measures:
        """The measures of a run that was not refused."""
        if self.measures is None:
            raise InputError(f"{self.method} on {self.recording}: {self.refusal}")
        return self.measures

    def __str__(self) -> str:
        at = f", H = {self.horizon}" if self.horizon else ""
        head = f"{self.recording}, {self.method}, seed {self.seed}{at}"
        if self.measures is None:
            return f"{head}: {self.refusal}"
        found = self.measures
        return (
            f"{head}: R {1e3 * found.resistance:.2f} mohm "
            f"(true {1e3 * found.true_resistance:.2f}), "
            f"map {100 * found.flux_share:.2f} %, {self.wall_time:.0f} s"
        )


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
    _problems: dict[tuple[str, Variant], LadderProblem] = field(default_factory=dict)
    _runs: dict[Path, Run] = field(default_factory=dict)

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
            return method([made.experiment], made.validation, self.observer)

        return self._kept(Place(case, name), train, {"settings": settings})

    def ours(self, case: str) -> Run:
        """Return the run of our defaults: what `penode identify` does without any setting."""
        study = self.extent.ours

        def method(
            experiments: Sequence[Experiment], unseen: Sequence[Experiment], observer: Observer
        ) -> Fit:
            return identify(experiments, study=study, validation=unseen, observer=observer)

        return self.by_method(case, "ours", method, str(study))

    def fit(self, place: Place) -> Fit:
        """Return the fit kept at a place, without its comparisons."""
        return Fit.load(self.folder / place.folder)

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
            branches = Branches.at(folder / "branches.json", self._given(case, settings))
            return variant.start(self.case(case).experiment, seed).model, branches

        def train(horizon: int) -> Fit:
            made, (start, branches) = self.case(case), begun()
            plan = variant.plans(horizons, made.experiment, seed, self.extent)[horizon]
            return branches.train(self._problem(case, variant), start, plan, made.validation)

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

    def _problem(self, case: str, variant: Variant) -> LadderProblem:
        """Return the problem of a variant's structure: optimiser and windows do not matter."""
        structure = replace(variant, name="", label="", jittered=False, climbing=True)
        key = (case, structure)
        if key not in self._problems:
            if any(other != case for other, _ in self._problems):
                # Compiled programs hold hundreds of megabytes, and are of one recording's use.
                self._problems.clear()
                forget: Callable[[], None] = jax.clear_caches
                forget()
            run = self.case(case).experiment
            start = structure.start(run, 0)
            plan = start.with_penalties(structure.plans((1,), run, 0, self.extent)[1])
            self._problems[key] = LadderProblem.of(start.model, [run], plan, self.observer)
        return self._problems[key]

    def _kept(self, place: Place, train: Callable[[], Fit], settings: Mapping[str, str]) -> Run:
        """Return the run kept at a place, or train and keep it.

        A run that was made in another way or on other recordings is made anew.
        """
        folder = self.folder / place.folder
        path, given = folder / "run.json", self._given(place.recording, settings)
        run = _read(path, given)
        if run is None:
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
            run = Run(**vars(place), measures=measures, refusal=refusal)
            run = replace(run, wall_time=spent[0], processor_time=spent[1])
            write_atomically(path, to_json({"given": given, **asdict(run)}))
            self.say(str(run))
        self._runs[place.folder] = run
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


def _read(path: Path, given: Mapping[str, Any]) -> Run | None:
    try:
        record = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict) or record.pop("given", None) != given:
        return None
    measures = record.pop("measures")
    return Run(**record, measures=Measures.restored(measures) if measures else None)
