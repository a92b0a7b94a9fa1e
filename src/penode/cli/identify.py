"""The command ``penode identify``."""

import time
import webbrowser
from functools import partial
from pathlib import Path

import typer

from penode.cli import options
from penode.cli.console import ERRORS, say
from penode.cli.fits import print_fit, report_beside, signed
from penode.cli.progress import watched
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.fit.result_folder import REPORT, RESULT, claimed
from penode.horizon.checkpoint import Checkpoint
from penode.identify import Stopped
from penode.pmsm.points.identify import identify_points
from penode.pmsm.points.operating_points import load_runs
from penode.pmsm.result_files import write_answer
from penode.pmsm.study import identify, identify_with_points
from penode.pmsm.study_file import load_study


def identify_command(  # noqa: PLR0913 (an argument an option)
    runs: list[Path],
    out: Path,
    validate: list[Path] | None,
    points: Path | None,
    points_config: Path | None,
    config: list[Path] | None,
    horizon: str | None,
    flux_map: str | None,
    inverter: bool | None,
    terms: str | None,
    angle_orders: str | None,
    hold: str | None,
    pole_pairs: int | None,
    purpose: str | None,
    seed: int | None,
    train_anyway: bool,
    resume: bool,
    overwrite: bool,
    show: bool,
    as_json: bool,
) -> None:
    """Identify resistance and flux-linkage map from recordings of a drive."""
    began = time.monotonic()
    checkpoint = _checkpoint(out, resume, overwrite)
    settings = options.given(
        flux_map=flux_map,
        seed=seed,
        inverter=inverter,
        terms=terms,
        angle_orders=angle_orders,
        hold=hold,
        pole_pairs=pole_pairs,
        purpose=purpose,
        train_anyway=train_anyway or None,
    )
    asked = options.load_studies(
        config, settings if horizon is None else {**settings, "horizon": _steps(horizon)}
    )
    of_points = asked
    if points_config is not None:
        if points is None:
            raise InputError("--points-config must be given with --points, got none; add it.")
        of_points = load_study(points_config, options.given(pole_pairs=pole_pairs))
    recordings, alone = load_runs(runs, asked.mapping)
    if alone is not None:
        _require_points_alone(
            horizon=horizon, validate=validate, hold=hold, purpose=purpose, points=points
        )
        with claimed(out):
            fit = signed(identify_points(alone, asked.study), began, asked.entries)
            write_answer(fit, out)
        return _ended(fit, out, as_json, show)
    beside = None if points is None else of_points.load_points(points)
    unseen = [stretch for run in validate or [] for stretch in asked.load_stretches(run)]
    stopped = False
    with watched(out, ERRORS, checkpoint) as observer:
        try:
            train = identify if beside is None else partial(identify_with_points, points=beside)
            fit = train(
                recordings,
                study=asked.study,
                validation=unseen,
                observer=observer,
                checkpoint=checkpoint,
            )
        except Stopped as stop:
            fit, stopped = stop.fit, True
        fit = signed(fit, began, asked.entries)
        write_answer(fit, out)
        if not stopped:
            checkpoint.path.unlink(missing_ok=True)
    _ended(fit, out, as_json, show, stopped)


def _ended(fit: Fit, out: Path, as_json: bool, show: bool, stopped: bool = False) -> None:
    """Print what was found, report it, and end with the command's status."""
    if as_json:
        typer.echo((out / "result.json").read_text())
    else:
        print_fit(fit, out)
    report_beside(fit, out, quiet=as_json)
    if show:
        _open(out / REPORT)
    if stopped:
        say("Stopped; this is the best so far. Add --resume to go on.")
        raise typer.Exit(130)
    if not fit.horizon.answered:
        raise typer.Exit(1)


def _require_points_alone(**options: object) -> None:
    """Refuse options that mean nothing for operating points."""
    for name, option in options.items():
        if option is not None:
            raise InputError(
                f"--{name} must be left out for a table of operating points, which has no horizon, "
                f"got {option}."
            )


def _steps(horizon: str) -> int | None:
    if horizon == "auto":
        return None
    try:
        return int(horizon)
    except ValueError as error:
        raise InputError(
            f"--horizon must be auto or a whole number of steps >= 1, got {horizon}."
        ) from error


def _checkpoint(out: Path, resume: bool, overwrite: bool) -> Checkpoint:
    """Return where horizons are kept; refuse to replace a result that nobody asked to replace."""
    path = out / "fit" / "checkpoint.json"
    stopped = path.exists()
    if (out / RESULT).exists() and not (overwrite or (resume and stopped)):
        what, go_on = "a finished result", ""
        if stopped:
            what, go_on = "a fit that was stopped", "add --resume to go on with it, "
        raise InputError(
            f"{out} has {what}: {go_on}add --overwrite to replace it, or give another --out."
        )
    if resume and not stopped:
        say(f"note: {path} is missing, so nothing is resumed; beginning anew.")
    return Checkpoint(path, resume and stopped)


def _open(page: Path) -> None:
    """Open a report in the browser; where there is neither, that is a note."""
    if page.exists() and not webbrowser.open(page.resolve().as_uri()):
        say(f"note: no browser could be started; open {page} yourself.")
