"""Sweep: independent identifications at horizons and from seeds, each kept as it ends."""

import csv
import hashlib
import io
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from penode.data.experiment import Experiment
from penode.data.windows import check_length
from penode.errors import InputError
from penode.fit.archive import to_json, write_atomically
from penode.fit.provenance import penode_version
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.studies.panels import Panel, Series
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study
from penode.report.quantities import scale_for

#: Seconds until Ctrl-C is noticed.
_NOTICE = 0.2
_MOST_SEEDS = 10_000
_COLOURS = ("coenergy", "inverter", "harmonics")


@dataclass(frozen=True)
class Swept:
    """One identification of a sweep.

    Attributes
    ----------
    horizon, seed : int
    parameters, std : mapping of str to float
        Physical parameters and their deviations, SI units; none where training failed.
    units : mapping of str to str
        SI units of the parameters.
    rmse : float
        Root mean squared error over the horizon, in A.
    free_run_rmse : float
        On the recordings trained on, in A; infinite after a divergence.
    wall_time : float
        s.
    failure : str
        Why there is no answer, as a sentence; empty where there is one.
    """

    horizon: int
    seed: int
    parameters: Mapping[str, float]
    std: Mapping[str, float]
    units: Mapping[str, str]
    rmse: float
    free_run_rmse: float
    wall_time: float
    failure: str = ""


def sweep(
    experiments: Sequence[Experiment],
    study: Study,
    grid: Sequence[tuple[int, int]],
    folder: Path,
    executor: Executor,
    resume: bool = False,
) -> Iterator[Swept]:
    """Identify at every horizon and seed of a grid, and give each as it ends.

    Parameters
    ----------
    experiments : sequence of Experiment
        As for `penode.pmsm.identify`.
    study : Study
        What is the same for all; terms that it leaves open are decided once, from the recordings.
    grid : sequence of (int, int)
        Horizons and seeds.
    folder : Path
        Gets ``seedN/HN/fit`` and ``seedN/HN/swept.json``.
    executor : Executor
        Where the identifications run.
    resume : bool
        Whether those that are there already, made from the same recordings in the same way, stay.

    Raises
    ------
    InputError
        If a recording cannot be used, or is too short for a horizon.
    """
    recordings = [drive_recording(e) for e in study.excerpt(experiments).experiments]
    for recording in recordings:
        check_length(recording, max(horizon for horizon, _ in grid), past=1)
    study, *_ = study.decided(recordings)
    study.check(recordings)
    waiting: set[Future[Swept]] = set()
    for horizon, seed in grid:
        one = replace(study, horizon=horizon, seed=seed)
        place, given = folder / f"seed{seed}" / f"H{horizon}", _given(recordings, one)
        kept = _read(place / "swept.json", given) if resume else None
        if kept is not None:
            yield kept
        else:
            waiting.add(executor.submit(_train, recordings, one, place, given))
    while waiting:
        # A wait without end would not notice Ctrl-C before the next one is done.
        done, waiting = wait(waiting, timeout=_NOTICE, return_when=FIRST_COMPLETED)
        for future in done:
            yield future.result()


def write_sweep(swept: Sequence[Swept], folder: Path) -> None:
    """Write ``sweep.csv`` and ``sweep.png`` into a folder.

    Parameters
    ----------
    swept : sequence of Swept
        At least one.
    folder : Path
    """
    write_atomically(folder / "sweep.csv", _table(swept))
    # Imported here: the plotting library takes a third of a second, and every command would pay it.
    from penode.pmsm.studies.study_figure import study_figure

    write_atomically(folder / "sweep.png", study_figure(_panels(swept)))


def grid_of(horizons: Sequence[int], seeds: int) -> list[tuple[int, int]]:
    """Return every horizon with every seed.

    Parameters
    ----------
    horizons : sequence of int
        Steps.
    seeds : int
        How many, from 0.

    Raises
    ------
    InputError
        If there is none of either, a horizon is below 1 or comes twice, or seeds are more than
        anyone waits for.
    """
    if not horizons or min(horizons) < 1 or len(set(horizons)) < len(horizons):
        raise InputError(f"horizons {list(horizons)} came; give distinct whole numbers from 1.")
    if not 1 <= seeds <= _MOST_SEEDS:
        raise InputError(f"{seeds} seeds came; give 1 to {_MOST_SEEDS}.")
    return list(product(horizons, range(seeds)))


def _train(
    experiments: Sequence[Experiment], study: Study, place: Path, given: Mapping[str, Any]
) -> Swept:
    """Identify at one horizon from one seed and keep the fit."""
    began, horizon = time.monotonic(), study.horizon or 0
    try:
        fit = identify(experiments, study=study)
    except InputError as error:
        spent = time.monotonic() - began
        swept = Swept(horizon, study.seed, {}, {}, {}, np.nan, np.inf, spent, str(error))
    else:
        rung = fit.horizon.ladder[-1]
        swept = Swept(
            horizon=rung.horizon,
            seed=study.seed,
            parameters=dict(rung.parameters),
            std=dict(rung.std),
            units={name: estimate.unit for name, estimate in fit.parameters.items()},
            rmse=rung.rmse,
            free_run_rmse=np.inf if rung.free_run_rmse is None else rung.free_run_rmse,
            wall_time=time.monotonic() - began,
        )
        fit.save(place)
    write_atomically(place / "swept.json", to_json({"given": given, **asdict(swept)}))
    return swept


def _given(experiments: Sequence[Experiment], study: Study) -> dict[str, Any]:
    """Return what a kept fit must have been made with."""
    digest = hashlib.sha256()
    for experiment in experiments:
        digest.update(repr(experiment.time_step).encode())
        for name in sorted(experiment.channels):
            digest.update(name.encode() + experiment.channels[name].tobytes())
    inputs = {"recordings": digest.hexdigest(), "study": str(study)}
    return {"penode": penode_version(), **inputs}


def _read(path: Path, given: Mapping[str, Any]) -> Swept | None:
    try:
        record = json.loads(path.read_text())
        if record.pop("given") != given:
            return None
        swept = Swept(**record)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None
    return replace(
        swept,
        std={name: _number(std) for name, std in swept.std.items()},
        rmse=_number(swept.rmse),
        free_run_rmse=_number(swept.free_run_rmse),
    )


def _number(value: float | None) -> float:
    """Return a number; what JSON could not hold was infinite."""
    return np.inf if value is None else value


def _names(swept: Sequence[Swept]) -> list[str]:
    return list(dict.fromkeys(name for one in swept for name in one.parameters))


def _table(swept: Sequence[Swept]) -> str:
    """Return a row a fit, SI units."""
    names = _names(swept)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    spread = [column for name in names for column in (name, f"{name}_std")]
    writer.writerow(["horizon", "seed", *spread, "rmse", "free_run_rmse", "wall_time", "failure"])
    for one in swept:
        pairs = [(one.parameters.get(n, np.nan), one.std.get(n, np.nan)) for n in names]
        numbers = [*(v for pair in pairs for v in pair), one.rmse, one.free_run_rmse, one.wall_time]
        shown = [f"{number:.9g}" for number in numbers]
        writer.writerow([one.horizon, one.seed, *shown, one.failure])
    return text.getvalue()


def _panels(swept: Sequence[Swept]) -> list[Panel]:
    """Return a panel a physical parameter, and one of the free run."""
    horizon, x = "integration horizon H (steps)", [float(one.horizon) for one in swept]
    panels = []
    for name, colour in zip(_names(swept), _COLOURS, strict=False):
        values = [one.parameters.get(name, np.nan) for one in swept]
        unit = next(one.units[name] for one in swept if name in one.units)
        scale = scale_for(values, unit)
        y = [value * scale.factor for value in values]
        panels.append(
            Panel(
                f"{name} over the horizon, a marker a seed",
                horizon,
                f"{name} ({scale.unit})",
                (Series("", x, y, colour),),
                legend=False,
            )
        )
    errors = [one.free_run_rmse for one in swept]
    finite = [error if np.isfinite(error) else np.nan for error in errors]
    free = Series("", x, finite, "other")
    title = "Free run on the recordings trained on"
    return [
        *panels,
        Panel(
            title, horizon, "RMSE (A)", (free,), y_log=bool(np.isfinite(finite).any()), legend=False
        ),
    ]
