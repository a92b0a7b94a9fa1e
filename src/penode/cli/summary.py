"""The last lines on the terminal: the answer, how far to trust it, and where the files are."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from penode.pmsm.demo import Demo
from penode.report.quantities import decimals_for, fixed, number, scale_for
from penode.training.fit import Estimate, Fit


def print_fit(console: Console, fit: Fit, folder: Path) -> None:
    """Print parameters with intervals, the horizon and its verdict, free runs, warnings, files."""
    table = _grid()
    for name, estimate in fit.parameters.items():
        table.add_row(name, _interval(estimate))
    choice = fit.horizon
    table.add_row("horizon", f"{choice.selected} steps: {choice.verdict}. {choice.reason}")
    for reason in fit.provenance.get("structure", ()):
        table.add_row("model", reason)
    for comparison in fit.comparisons:
        unit = comparison.units[0]
        table.add_row(
            comparison.role,
            f"{comparison.name}: one step {number(comparison.one_step_rmse)} {unit}, "
            f"free run {_free(comparison.free_run_rmse, unit)} RMSE",
        )
    for warning in fit.warnings:
        table.add_row("[yellow]warning[/]", warning)
    table.add_row("map", str(folder / "flux_map.csv"))
    table.add_row("report", str(folder / "report.html"))
    console.print(table, highlight=False)


def print_demo(console: Console, demo: Demo) -> None:
    """Print the errors against the truth of the built-in machine."""
    estimate = demo.fit.parameters["R"]
    low, high = estimate.interval_95
    covered = "inside" if low <= demo.true_resistance <= high else "OUTSIDE"
    error = 100 * (estimate.value / demo.true_resistance - 1)
    table = _grid()
    table.add_row(
        "truth",
        f"R = {number(1e3 * demo.true_resistance, 4)} mΩ: error {error:+.2f} %, {covered} the "
        "interval",
    )
    table.add_row(
        "",
        f"flux linkage: mean absolute error {number(1e3 * demo.flux_error)} mVs, "
        f"{number(100 * demo.flux_share)} % of the magnet's",
    )
    console.print(table, highlight=False)


def _grid() -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    return table


def _interval(estimate: Estimate) -> str:
    scale = scale_for(estimate.value, estimate.unit)
    value, std = estimate.value * scale.factor, estimate.std * scale.factor
    decimals = decimals_for(std, value)
    low, high = (fixed(end * scale.factor, decimals) for end in estimate.interval_95)
    return f"{fixed(value, decimals)} {scale.unit}, 95 % interval {low} to {high} {scale.unit}"


def _free(value: float, unit: str) -> str:
    return f"{number(value)} {unit}" if np.isfinite(value) else "diverges,"
