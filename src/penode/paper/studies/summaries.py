"""Runs summed up: rows for the files, points for the figures, numbers for the sentences."""

from collections.abc import Callable, Sequence

import numpy as np

from penode.paper.studies.measures import Measures
from penode.paper.studies.panels import Series
from penode.paper.studies.runs import Run
from penode.paper.studies.variants import Variant

#: Takes what was measured of a fit.
Value = Callable[[Measures], float]


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
        }
        head |= dict(measures.others)
    times = {"wall_time_s": run.wall_time, "processor_time_s": run.processor_time}
    return {**head, **times, "refusal": run.refusal}


def rows(groups: Sequence[Sequence[Run]]) -> list[dict[str, object]]:
    """Return all runs as rows."""
    return [row(run) for group in groups for run in group]


def good(runs: Sequence[Run]) -> list[Run]:
    """Return the runs that were not refused."""
    return [run for run in runs if run.measures is not None]


def at(runs: Sequence[Run], horizon: int, value: Value) -> list[float]:
    """Return a value of every seed at a horizon."""
    return [value(run.result) for run in good(runs) if run.horizon == horizon]


def mean_at(runs: Sequence[Run], horizon: int, value: Value) -> float:
    """Return the mean of a value over the seeds at a horizon; nan without any."""
    values = at(runs, horizon, value)
    return float(np.mean(values)) if values else float("nan")


def over_horizon(variant: Variant, runs: Sequence[Run], value: Value) -> Series:
    """Return a marker a seed over the horizon."""
    kept = good(runs)
    x = [float(run.horizon) for run in kept]
    return Series(variant.label, x, [value(run.result) for run in kept], variant.name)


def star(run: Run, value: Value) -> Series:
    """Return our defaults as one point at the horizon they chose."""
    if run.measures is None:
        return Series("", (), (), "ours", "*", joined=False)
    label = f"our defaults (chose H = {run.result.horizon})"
    x, y = [float(run.result.horizon)], [value(run.result)]
    return Series(label, x, y, "ours", "*", joined=False)


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


def spread(values: Sequence[float]) -> float:
    """Return the largest minus the smallest value."""
    return float(np.ptp(values)) if len(values) else float("nan")


def listed(values: Sequence[float], digits: int = 3) -> str:
    """Return numbers as a list in words."""
    return ", ".join(f"{value:.{digits}g}" for value in values)
