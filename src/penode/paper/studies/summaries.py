"""What studies have in common: runs summed up in rows, points and numbers, and put into words."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, TypeAlias

import numpy as np

from penode.paper.studies.panels import Claim, Matrix, Panel, Series, StudyResult
from penode.paper.studies.runs import Measures, Run, Runs
from penode.paper.studies.variants import AXES, Variant

HORIZON = "integration horizon H (steps)"

#: Takes what was measured of a fit.
Value: TypeAlias = Callable[[Measures], float]
#: A statement's name in ``texts.toml``, whether it holds, and the numbers in it.
Judged: TypeAlias = tuple[str, bool, Mapping[str, Any]]


def milliohm(measures: Measures) -> float:
    """Return R in mohm."""
    return 1e3 * measures.resistance


def error_percent(measures: Measures) -> float:
    """Return the error of R in per cent."""
    return 100 * measures.error


def flux_percent(measures: Measures) -> float:
    """Return the mean absolute error of the map in per cent of psi_PM."""
    return 100 * measures.flux_share


def row(run: Run) -> dict[str, object]:
    """Return a run as a row of a table, in the units of its column names."""
    head: dict[str, object] = {
        "recording": run.recording,
        "method": run.method,
        "seed": run.seed,
        "horizon": run.horizon or None,
    }
    if run.measures is not None:
        measures = run.measures
        head |= {
            "horizon": run.horizon or measures.horizon,
            "R_mohm": milliohm(measures),
            "R_std_mohm": 1e3 * measures.deviation,
            "R_true_mohm": 1e3 * measures.true_resistance,
            "R_error_percent": error_percent(measures),
            "flux_mae_mVs": 1e3 * measures.flux_mae,
            "flux_mae_percent_of_psi_PM": flux_percent(measures),
            "rmse_over_the_horizon_A": measures.trained,
            "one_step_mse_train_A2": measures.one_step_train,
            "one_step_mse_unseen_A2": measures.unseen_one_step,
            "free_run_rmse_unseen_A": measures.unseen_free_run,
            "verdict": measures.verdict,
            **measures.others,
        }
    times = {"wall_time_s": run.wall_time, "processor_time_s": run.processor_time}
    return {**head, **times, "refusal": run.refusal}


def good(runs: Sequence[Run]) -> list[Run]:
    """Return the runs that were not refused."""
    return [run for run in runs if run.measures is not None]


@dataclass(frozen=True)
class Trained:
    """Runs of variants on one recording over horizons and seeds, and that of our defaults."""

    label: str
    by: Mapping[str, list[Run]]
    ours: Run

    @classmethod
    def of(
        cls, runs: Runs, case: str, variants: Sequence[Variant] = AXES, few: bool = False
    ) -> "Trained":
        """Train those of the variants that the extent has; one seed at few horizons if asked."""
        extent, by = runs.extent, {}
        for variant in variants:
            if variant.name in extent.variants:
                # A map with angle orders takes several times as long.
                short = few or bool(variant.angle_orders)
                horizons = extent.few_horizons if short else extent.horizons
                seeds = extent.seeds[:1] if short else extent.seeds
                by[variant.name] = runs.at_horizons(case, variant, horizons, seeds)
        return cls(runs.case(case).label, by, runs.ours(case))

    @property
    def truth(self) -> float:
        """True R in mohm."""
        return 1e3 * self.ours.result.true_resistance

    @property
    def rows(self) -> list[dict[str, object]]:
        """All runs as rows of a table."""
        return [row(run) for group in (*self.by.values(), [self.ours]) for run in group]

    def at(self, variant: Variant, horizon: int, value: Value) -> list[float]:
        """Return a value of every seed at a horizon."""
        runs = good(self.by[variant.name])
        return [value(run.result) for run in runs if run.horizon == horizon]

    def mean(self, variant: Variant, horizon: int, value: Value) -> float:
        """Return the mean of a value over the seeds at a horizon; nan without any."""
        values = self.at(variant, horizon, value)
        return float(np.mean(values)) if values else float("nan")

    def spread(self, variant: Variant, horizon: int, value: Value) -> float:
        """Return the largest minus the smallest value of the seeds at a horizon."""
        values = self.at(variant, horizon, value)
        return float(np.ptp(values)) if values else float("nan")

    def series(self, value: Value, variants: Sequence[Variant] = AXES) -> tuple[Series, ...]:
        """Return a marker a seed over the horizon, a series for each variant that was run."""
        return tuple(
            over_horizon(variant, self.by[variant.name], value)
            for variant in variants
            if variant.name in self.by
        )

    def star(self, value: Value) -> Series:
        """Return our defaults as one point at the horizon they chose."""
        if self.ours.measures is None:
            return Series("", (), (), "ours", "*")
        found = self.ours.result
        label = f"our defaults (chose H = {found.horizon})"
        return Series(label, [float(found.horizon)], [value(found)], "ours", "*")

    def resistance_panel(
        self, title: str, series: Sequence[Series], limits: tuple[float, float] | None = None
    ) -> Panel:
        """Return series of R in mohm over the horizon, and our defaults beside them."""
        shown = (*series, self.star(milliohm))
        return Panel(title, HORIZON, "estimated R (mΩ)", shown, self.truth, y_limits=limits)

    def flux_panel(self, title: str, legend: bool = True) -> Panel:
        """Return the error of all maps over the horizon."""
        shown = (*self.series(flux_percent), self.star(flux_percent))
        label = "mean |error| of ψ_d, ψ_q (% of ψ_PM)"
        return Panel(title, HORIZON, label, shown, y_log=True, legend=legend)

    def ours_within(self, resistance: float, flux: float = np.inf) -> Judged:
        """Judge our defaults by the errors of R and of the map in per cent."""
        found = self.ours.result
        holds = abs(error_percent(found)) <= resistance and flux_percent(found) <= flux
        return "ours", holds, {"label": self.label, "ours": in_numbers(found)}


def over_horizon(variant: Variant, runs: Sequence[Run], value: Value) -> Series:
    """Return a marker a seed over the horizon."""
    kept = good(runs)
    x = [float(run.horizon) for run in kept]
    return Series(variant.label, x, [value(run.result) for run in kept], variant.name)


def limits(paper: Series, truth: float) -> tuple[float, float]:
    """Return limits of an axis that show the paper's recipe and the truth, whatever else is far."""
    finite = [value for value in paper.y if np.isfinite(value)] or [truth]
    return min(1.7 * min(finite), -truth), max(1.3 * max(finite), 5 * truth)


def in_numbers(measures: Measures) -> str:
    """Return R, map and horizon in words."""
    return (
        f"R {milliohm(measures):.3f} ± {1e3 * measures.deviation:.3f} mΩ "
        f"({error_percent(measures):+.2f} %), map {flux_percent(measures):.2f} % of ψ_PM, "
        f"H = {measures.horizon}, verdict: {measures.verdict}"
    )


def listed(values: Sequence[float], digits: int = 3) -> str:
    """Return numbers as a list in words."""
    return ", ".join(f"{value:.{digits}g}" for value in values)


@cache
def texts() -> dict[str, Any]:
    """Return the words of the studies by name, and of the page."""
    file = resources.files("penode.paper.studies") / "texts.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def told(
    name: str,
    rows: list[dict[str, object]],
    panels: Sequence[Panel | Matrix],
    judged: Sequence[Judged],
    columns: tuple[str, ...] = (),
    **numbers: object,
) -> StudyResult:
    """Return what a study says: its words with the numbers in them."""
    words = texts()[name]
    claims = [(words["claims"][key], holds, given) for key, holds, given in judged]
    return StudyResult(
        name=name,
        title=words["title"],
        question=words["question"].format(**numbers),
        rows=rows,
        panels=tuple(panels),
        claims=tuple(
            Claim(one["text"].format(**given), holds, one["evidence"].format(**given))
            for one, holds, given in claims
        ),
        reading=words["reading"].format(**numbers),
        columns=columns,
    )
