"""The last lines on the terminal: the answer, how far to trust it, and where the files are."""

from pathlib import Path

from rich.console import Console
from rich.text import Text

from penode.cli.rows import print_rows
from penode.fit.fit import Estimate, Fit
from penode.pmsm.demo import Demo
from penode.report.quantities import decimals_for, fixed, number, scale_for
from penode.report.statements import free_run_text, one_step_text
from penode.report.uncertainty_budget import budget_sentence


def print_fit(console: Console, fit: Fit, folder: Path) -> None:
    """Print parameters with intervals, the horizon and its verdict, free runs, warnings, files."""
    choice = fit.horizon
    verdict = Text(choice.verdict, style="green" if choice.answered else "red")
    steps = "step" if choice.selected == 1 else "steps"
    rows: list[tuple[str, str | Text]] = [
        *((name, _interval(estimate)) for name, estimate in fit.parameters.items()),
        *(
            ("budget", f"{name}: {line}")
            for name, estimate in fit.parameters.items()
            if (line := budget_sentence(estimate))
        ),
        ("horizon", Text.assemble(f"{choice.selected} {steps}: ", verdict, f". {choice.reason}")),
        *(("model", reason) for reason in fit.provenance.get("structure", ())),
    ]
    for comparison in fit.recordings:
        one_step, free_run = one_step_text(comparison), free_run_text(comparison)
        errors = f"{comparison.name}: RMSE one step {one_step}; free run {free_run}"
        rows.append((comparison.role, errors.replace("\N{NO-BREAK SPACE}", " ")))
    rows += [("warning", warning) for warning in fit.warnings]
    rows.append(("map", str(folder / "flux_map.csv")))
    print_rows(console, rows)


def print_demo(console: Console, demo: Demo) -> None:
    """Print the errors against the truth of the built-in machine."""
    estimate = demo.fit.parameters["R"]
    low, high = estimate.interval_95
    covered = "inside" if low <= demo.true_resistance <= high else "OUTSIDE"
    error = 100 * (estimate.value / demo.true_resistance - 1)
    resistance = (
        f"R = {number(1e3 * demo.true_resistance, 4)} mΩ: error {error:+.2f} %, {covered} the "
        "interval"
    )
    flux = (
        f"flux linkage: mean absolute error {number(1e3 * demo.flux_error)} mVs, "
        f"{number(100 * demo.flux_share)} % of the magnet's"
    )
    print_rows(console, [("truth", resistance), ("truth", flux)])


def _interval(estimate: Estimate) -> str:
    scale = scale_for(estimate.value, estimate.unit)
    value, std = estimate.value * scale.factor, estimate.std * scale.factor
    decimals = decimals_for(std, value)
    low, high = (fixed(end * scale.factor, decimals) for end in estimate.interval_95)
    return f"{fixed(value, decimals)} {scale.unit}, 95 % interval {low} to {high} {scale.unit}"
