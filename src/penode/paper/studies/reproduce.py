"""Reproduction: the studies by name, what they write, and the page that sums them up."""

import csv
import io
import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from penode.errors import InputError
from penode.fit.archive import to_json, write_atomically
from penode.fit.provenance import versions
from penode.horizon.ladder import Observer, ignore_events
from penode.paper.studies.over_horizons import (
    flux_error_vs_horizon,
    generalisation_vs_horizon,
    resistance_vs_horizon,
    subdomain,
    testbench_resistance,
    well_designed,
)
from penode.paper.studies.panels import StudyResult
from penode.paper.studies.results_page import results_page
from penode.paper.studies.runs import Runs, Say
from penode.paper.studies.side_by_side import method_table, solver_dependence
from penode.paper.studies.study_figure import study_figure
from penode.paper.studies.variants import FULL, Extent

#: Name to the study, in the order in which they are computed and shown.
STUDIES: dict[str, Callable[[Runs], StudyResult]] = {
    "resistance_vs_horizon": resistance_vs_horizon,
    "flux_error_vs_horizon": flux_error_vs_horizon,
    "generalisation_vs_horizon": generalisation_vs_horizon,
    "testbench_resistance": testbench_resistance,
    "well_designed": well_designed,
    "subdomain": subdomain,
    "solver_dependence": solver_dependence,
    "table": method_table,
}


def chosen_studies(name: str) -> list[str]:
    """Return the names of studies meant by one, or all; refuse a name of none."""
    if name == "all":
        return list(STUDIES)
    if name not in STUDIES:
        raise InputError(f"study must be all or one of {', '.join(STUDIES)}, got {name!r}.")
    return [name]


def reproduce(
    names: Sequence[str],
    folder: Path,
    extent: Extent = FULL,
    say: Say = print,
    observer: Observer = ignore_events,
) -> tuple[Path, list[StudyResult]]:
    """Compute studies and write them; return the page and the result of each.

    What is there already is taken over.

    The folder gets ``runs/`` with every trained fit, for each study (a key of `STUDIES`)
    ``NAME.json``, ``NAME.csv`` and ``figures/studies_NAME.png``, and ``results.md``. ``say`` is
    called with lines of progress, ``observer`` with each evaluation.
    """
    runs, results = Runs(folder / "runs", extent, say, observer), list[StudyResult]()
    page = folder / "results.md"
    for name in names:
        began = time.monotonic()
        result = STUDIES[name](runs) if extent.judges else STUDIES[name](runs).unjudged()
        facts = _facts(extent, time.monotonic() - began)
        _write(result, folder, facts)
        say(f"{name}: {result.outcome}")
        results.append(result)
        write_atomically(page, results_page(results, _facts(extent, runs.spent)))
    return page, results


def _write(result: StudyResult, folder: Path, facts: dict[str, Any]) -> None:
    """Write a study's numbers as JSON and CSV, and its figure."""
    document = {
        "name": result.name,
        "title": result.title,
        "claims": [asdict(claim) for claim in result.claims],
        "rows": result.rows,
        "provenance": facts,
    }
    write_atomically(folder / f"{result.name}.json", to_json(document))
    table, columns = io.StringIO(), dict.fromkeys(name for row in result.rows for name in row)
    writer = csv.DictWriter(table, list(columns), lineterminator="\n")
    writer.writeheader()
    for row in result.rows:
        writer.writerow({k: f"{v:.9g}" if isinstance(v, float) else v for k, v in row.items()})
    write_atomically(folder / f"{result.name}.csv", table.getvalue())
    picture = folder / "figures" / f"studies_{result.name}.png"
    write_atomically(picture, study_figure(result.panels))


def _facts(extent: Extent, seconds: float) -> dict[str, Any]:
    """Return machine, versions and time."""
    return {
        "machine": f"{_processor()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "versions": versions(),
        "extent": asdict(extent),
        "wall_time_s": round(seconds, 1),
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()
