"""Fits that commands read, sign, print and report."""

import math
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.text import Text

from penode.cli.console import OUTPUT, Interrupted, Row, print_rows, say, why_and_status
from penode.errors import InputError
from penode.fit.fit import Estimate, Fit
from penode.fit.left_out import LOG, left_out
from penode.fit.result_folder import REPORT, claimed
from penode.pmsm.demo import Demo
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.machine.model import Machine
from penode.pmsm.report.no_current import no_current, of_winding
from penode.pmsm.result_files import write_report
from penode.report.quantities import number
from penode.report.statements import (
    estimate_text,
    free_run_text,
    one_step_text,
    relative_error,
    verdict_notice,
)
from penode.report.uncertainty_budget import budget_sentence

#: Width of an interval over the value from which its ends are no numbers to be read.
_TOO_WIDE = 1000.0


def load_machine(folder: Path, trust: bool = False) -> Fit:
    """Return the fit of a machine from the folder that identify or demo wrote; refuse another's.

    ``trust`` imports modules other than penode's for the classes of the fit.
    """
    fit = Fit.load(folder, trust)
    maps = sorted(fit.model.maps())
    if "flux_map" not in maps:
        raise InputError(
            f"{folder}: the fit must be one of a machine, got one with the maps "
            f"{', '.join(maps) or 'none'}; give a folder that penode identify wrote."
        )
    return fit


def require_same_pole_pairs(fit: Fit, pole_pairs: int | None) -> None:
    """Refuse pole pairs other than those that a fit was identified with."""
    stored = fit.provenance.get("pole_pairs")
    if stored and pole_pairs not in (None, stored):
        raise InputError(
            f"pole pairs must be {stored}, as the fit was identified with, got {pole_pairs}; "
            "leave --pole-pairs out."
        )


def end_unless_answered(fit: Fit) -> None:
    """End with a warning and exit status 1 where the recordings could not answer."""
    if not fit.horizon.answered:
        say(
            f"warning: the verdict of this fit is {fit.horizon.verdict!r}; R is left out, and the "
            "map is as doubtful as R."
        )
        raise typer.Exit(1)


def signed(fit: Fit, began: float, entries: Mapping[str, Any] | None = None) -> Fit:
    """Add the command, its wall time and the entries of its study file to the provenance."""
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
    facts: dict[str, Any] = {"command": command, "wall_time_s": round(time.monotonic() - began, 2)}
    if entries:
        facts["study_file"] = dict(entries)
    return replace(fit, provenance={**fit.provenance, **facts})


def print_fit(fit: Fit, folder: Path, console: Console = OUTPUT) -> None:
    """Print parameters with intervals, the horizon and its verdict, free runs, warnings, files."""
    choice = fit.horizon
    verdict = Text(verdict_notice(choice).label, style="green" if choice.answered else "red")
    steps = "step" if choice.selected == 1 else "steps"
    budgets = ((n, budget_sentence(estimate)) for n, estimate in fit.parameters.items())
    rows: list[Row] = [
        *((name, _shown(fit, estimate)) for name, estimate in fit.parameters.items()),
        *(
            ("budget", f"{name}: {line}")
            for name, line in budgets
            if line and not _is_too_wide(fit, fit.parameters[name])
        ),
        *_no_current(fit),
        ("verdict", Text.assemble(verdict, f". {choice.reason}")),
        *([("horizon", f"{choice.selected} {steps}")] if choice.selected else []),
        *(("model", reason) for reason in fit.provenance.get("structure", ())),
    ]
    for comparison in fit.recordings:
        one_step, free_run = one_step_text(comparison), free_run_text(comparison)
        errors = (
            f"{comparison.name}: RMSE one step from a noisy sample {one_step}; free run {free_run}"
        )
        if math.isfinite(share := 100 * relative_error(comparison)):
            errors += f" ({number(share, 2)} % of the largest value)"
        rows.append((comparison.role, errors.replace("\N{NO-BREAK SPACE}", " ")))
    rows += [("points", line) for line in _stationary(fit)]
    rows += [("warning", warning) for warning in fit.warnings]
    print_rows([*rows, ("map", str(folder / "flux_map.csv"))], console)


def _no_current(fit: Fit) -> Iterator[Row]:
    """Yield what the map of a machine is at no current, and the temperature that R belongs to."""
    if isinstance(fit.model, Machine):
        for name, one in zip(("psi_PM", "L_d", "L_q"), no_current(fit), strict=False):
            said = ", ".join(filter(None, (one.text, "at no current", one.detail)))
            yield name, said.replace("\N{NO-BREAK SPACE}", " ")
        for one in of_winding(fit):
            yield "winding", one.detail.replace("\N{NO-BREAK SPACE}", " ")


def _stationary(fit: Fit) -> Iterator[str]:
    """Yield of each quantity at operating points how far the model is from it."""
    for name, errors in fit.stationary.metrics().items() if fit.stationary else ():
        yield (
            f"{name}: RMSE {number(errors['rmse'])} {errors['unit']}; without the point "
            f"{number(errors['rmse_without'])} {errors['unit']}, "
            f"{100 * errors['within_95']:.0f} % within 95 %"
        )


def _shown(fit: Fit, estimate: Estimate) -> str:
    """Return a value with its interval; without an answer it says not to use it."""
    value, interval = (text.replace("\N{NO-BREAK SPACE}", " ") for text in estimate_text(estimate))
    said = f"{value}, 95 % interval {interval}"
    if _is_too_wide(fit, estimate):
        said = f"{value}, its interval too wide to mean anything"
    return said if fit.horizon.answered else f"no answer; must not be used: {said}"


def _is_too_wide(fit: Fit, estimate: Estimate) -> bool:
    """Whether there is no answer, and an interval whose ends are no numbers to be read."""
    low, high = estimate.interval_95
    return not fit.horizon.answered and not high - low <= _TOO_WIDE * abs(estimate.value)


def print_demo(demo: Demo, console: Console = OUTPUT) -> None:
    """Print the errors against the truth of the built-in machine."""
    estimate = demo.fit.parameters["R"]
    low, high = estimate.interval_95
    true = demo.machine.resistance
    covered = "inside" if low <= true <= high else "OUTSIDE"
    error = round(100 * (estimate.value / true - 1), 2) + 0.0
    resistance = f"R = {number(1e3 * true, 4)} mΩ: error {error:+.2f} %, {covered} the interval"
    flux = (
        f"flux linkage: mean absolute error {number(1e3 * demo.flux_error)} mVs, "
        f"{number(100 * demo.flux_share)} % of the magnet's"
    )
    print_rows([("truth", resistance), ("truth", flux)], console, below=_labels(demo.fit))


def _labels(fit: Fit) -> list[str]:
    """Return the longest labels that `print_fit` may print."""
    return ["horizon", *fit.parameters, *(one.role for one in fit.recordings)]


def report_beside(
    fit: Fit, folder: Path, quiet: bool = False, truth: FluxGrid | None = None
) -> None:
    """Make the report of a machine's result that lies whole in a folder; Ctrl-C is Interrupted.

    Where it cannot be made, that is said on standard error, and the result stands.
    """
    try:
        with claimed(folder):
            write_report(fit, folder, truth)
    except KeyboardInterrupt as error:
        raise Interrupted(
            f"Stopped; the result is written, its report is not: penode report {folder} makes it."
        ) from error
    except (InputError, OSError) as error:
        LOG.warning("The report was not written: %s", why_and_status(error)[0])
    except Exception as error:
        left_out("the report", error)
    else:
        if not quiet:
            print_rows([("report", str(folder / REPORT))], below=_labels(fit))
