"""Runs summed up: rows for the files, points for the figures, numbers for the sentences."""

from collections.abc import Callable, Sequence

import numpy as np

from penode.pmsm.studies.measures import Measures
from penode.pmsm.studies.panels import Series
from penode.pmsm.studies.runs import Run
from penode.pmsm.studies.variants import Variant

#: Takes what was measured of a fit.
Value = Callable[[Measures], float]


def milliohm(found: Measures) -> float:
    """Return R in mohm."""
    return 1e3 * found.resistance


def error_percent(found: Measures) -> float:
    """Return the error of R in per cent."""
    return 100 * found.error


def flux_percent(found: Measures) -> float:
    """Return the mean absolute error of the map in per cent of psi_PM."""
    return 100 * found.flux_share


def row(run: Run) -> dict[str, object]:
    """Return a run as a row of a table, in the units of its column names."""
    head: dict[str, object] = {
        "recording": run.recording,
        "method": run.method,
        "seed": run.seed,
        "horizon": run.horizon or None,
    }
    if run.measures is not None:
        found = run.measures
        head |= {
            "horizon": run.horizon or found.horizon,
            "R_mohm": milliohm(found),
            "R_std_mohm": 1e3 * found.deviation,
            "R_true_mohm": 1e3 * found.true_resistance,
            "R_error_percent": error_percent(found),
            "flux_mae_mVs": 1e3 * found.flux_mae,
            "flux_mae_percent_of_psi_PM": flux_percent(found),
            "rmse_over_the_horizon_A": found.trained,
            "one_step_mse_train_A2": found.one_step_train,
            "one_step_mse_unseen_A2": found.unseen_one_step,
            "free_run_rmse_unseen_A": found.unseen_free_run,
            "verdict": found.verdict,
        }
        head |= dict(found.others)
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
    return [value(run.found) for run in good(runs) if run.horizon == horizon]


def mean_at(runs: Sequence[Run], horizon: int, value: Value) -> float:
    """Return the mean of a value over the seeds at a horizon; nan without any."""
    found = at(runs, horizon, value)
    return float(np.mean(found)) if found else float("nan")


def over_horizon(variant: Variant, runs: Sequence[Run], value: Value) -> Series:
    """Return a marker a seed over the horizon."""
    kept = good(runs)
    x = [float(run.horizon) for run in kept]
    return Series(variant.label, x, [value(run.found) for run in kept], variant.name)


def star(run: Run, value: Value) -> Series:
    """Return our defaults as one point at the horizon they chose."""
    if run.measures is None:
        return Series("", (), (), "ours", "*", joined=False)
    label = f"our defaults (chose H = {run.found.horizon})"
    x, y = [float(run.found.horizon)], [value(run.found)]
    return Series(label, x, y, "ours", "*", joined=False)


def limits(paper: Series, truth: float) -> tuple[float, float]:
    """Return limits of an axis that show the paper's recipe and the truth, whatever else is far."""
    found = [value for value in paper.y if np.isfinite(value)] or [truth]
    return min(1.7 * min(found), -truth), max(1.3 * max(found), 5 * truth)


def told(found: Measures) -> str:
    """Return R, map and horizon in words."""
    return (
        f"R {milliohm(found):.3f} ± {1e3 * found.deviation:.3f} mΩ "
        f"({error_percent(found):+.2f} %), map {flux_percent(found):.2f} % of ψ_PM, "
        f"H = {found.horizon}, verdict: {found.verdict}"
    )


def spread(values: Sequence[float]) -> float:
    """Return the largest minus the smallest value."""
    return float(np.ptp(values)) if len(values) else float("nan")


def listed(values: Sequence[float], digits: int = 3) -> str:
    """Return numbers as a list in words."""
    return ", ".join(f"{value:.{digits}g}" for value in values)
