"""The command ``penode identify``."""

import time
import webbrowser
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from penode.cli import options
from penode.cli.console import ERRORS, say
from penode.cli.fits import print_fit, report_beside, signed
from penode.cli.progress import watched
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.fit.result_folder import REPORT, RESULT, claimed
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.held_out import PURPOSES
from penode.identify import Stopped
from penode.pmsm.points.identify import identify_points
from penode.pmsm.points.operating_points import load_runs
from penode.pmsm.result_files import write_answer
from penode.pmsm.study import identify, identify_with_points
from penode.pmsm.study_file import load_study


def identify_command(  # noqa: PLR0913 (an argument an option)
    runs: options.Recordings,
    out: options.OutFolder,
    validate: Annotated[
        list[Path] | None, typer.Option(help="Recording to predict, not to train on. Repeatable.")
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(help="Table of operating points of the same bench, which narrows R and map."),
    ] = None,
    points_config: Annotated[
        Path | None,
        typer.Option(
            help="Study file of that table: columns and units.", show_default="that of --config"
        ),
    ] = None,
    config: options.Configs = None,
    horizon: Annotated[
        str | None, typer.Option(help="auto, or the number of steps.", show_default="auto")
    ] = None,
    flux_map: options.FluxMapOption = None,
    inverter: options.Inverter = None,
    terms: options.Terms = None,
    angle_orders: options.AngleOrders = None,
    hold: options.HoldOption = None,
    pole_pairs: Annotated[
        int | None,
        typer.Option(help="Of the machine; a speed or angle of the shaft needs them.", min=1),
    ] = None,
    purpose: Annotated[
        str | None,
        typer.Option(
            help=f"What the horizon is chosen for: {', '.join(PURPOSES)}.",
            show_default="parameters",
            autocompletion=lambda: list(PURPOSES),
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            help="Seed of window placement, and of the draw of a map other than coenergy.",
            show_default="0",
            min=0,
            max=2**63 - 1,
        ),
    ] = None,
    train_anyway: Annotated[
        bool,
        typer.Option("--train-anyway", help="Train though a convention of the channels is broken."),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the fit that was stopped in --out.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the result that is in --out.")
    ] = False,
    show: Annotated[
        bool, typer.Option("--open", help="Open the report in the browser at the end.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead.")] = False,
) -> None:
    """Identify resistance and flux-linkage map from recordings of a drive.

    Columns: t (s), u_d and u_q (V), i_d and i_q (A), omega_el (rad/s, electrical), optionally
    theta_el (rad); or u_a .. u_c, i_a .. i_c and theta_el. Currents and voltages are peak values.
    A file without t is a table of operating points: torque (Nm) of the shaft counts there too.
    Anything else is mapped by a study file, given with --config; options override its entries.

    Ctrl-C stops with the best so far, written as a whole result; the same command with --resume
    added goes on after the last finished horizon. Ctrl-C a second time leaves at once.

    Exit status: 0 done, 1 the data cannot answer, 2 unusable input, 70 a failure of penode, 130
    stopped.

    Example: penode identify run.csv --validate other.csv --out result
    """
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
