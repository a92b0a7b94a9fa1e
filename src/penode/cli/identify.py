"""The command ``penode identify``."""

import time
from pathlib import Path
from typing import Annotated

import typer

from penode.cli import options
from penode.cli.console import ERRORS, say
from penode.cli.fits import print_fit, report_beside, signed
from penode.cli.progress import watched
from penode.errors import InputError
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.held_out import PURPOSES
from penode.identify import Stopped
from penode.pmsm.result_files import write_answer
from penode.pmsm.study import identify
from penode.pmsm.study_file import load_study


def identify_command(  # noqa: PLR0913 (an argument an option)
    runs: options.Recordings,
    out: options.OutFolder,
    validate: Annotated[
        list[Path] | None, typer.Option(help="Recording to predict, not to train on. Repeatable.")
    ] = None,
    config: options.Config = None,
    horizon: Annotated[
        str | None, typer.Option(help="auto, or the number of steps.", show_default="auto")
    ] = None,
    flux_map: options.FluxMapOption = None,
    inverter: options.Inverter = None,
    terms: options.Terms = None,
    angle_orders: options.AngleOrders = None,
    hold: options.HoldOption = None,
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
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead.")] = False,
) -> None:
    """Identify resistance and flux-linkage map from recordings of a drive.

    Columns: t (s), u_d and u_q (V), i_d and i_q (A), omega_el (rad/s, electrical), optionally
    theta_el (rad); or u_a .. u_c, i_a .. i_c and theta_el. Currents and voltages are peak values.
    Anything else is mapped by a study file, given with --config; options override its entries.

    Ctrl-C stops with the best so far, written as a whole result; the same command with --resume
    added goes on after the last finished horizon. Ctrl-C a second time leaves at once.

    Exit status: 0 done, 1 the data cannot answer, 2 unusable input, 130 stopped.

    Example: penode identify run.csv --validate other.csv --out result
    """
    began = time.monotonic()
    settings = options.given(
        flux_map=flux_map,
        seed=seed,
        inverter=inverter,
        terms=terms,
        angle_orders=angle_orders,
        hold=hold,
        purpose=purpose,
        train_anyway=train_anyway or None,
    )
    asked = load_study(
        config, settings if horizon is None else {**settings, "horizon": _steps(horizon)}
    )
    recordings = [stretch for run in runs for stretch in asked.load_stretches(run)]
    unseen = [stretch for run in validate or [] for stretch in asked.load_stretches(run)]
    checkpoint = _checkpoint(out, resume)
    stopped = False
    with watched(out, ERRORS, checkpoint) as observer:
        try:
            fit = identify(
                recordings,
                study=asked.study,
                validation=unseen,
                observer=observer,
                checkpoint=checkpoint,
            )
        except Stopped as stop:
            fit, stopped = stop.fit, True
        fit = signed(fit, began)
        write_answer(fit, out)
        if not stopped:
            checkpoint.path.unlink(missing_ok=True)
    if as_json:
        typer.echo((out / "result.json").read_text())
    else:
        print_fit(fit, out)
    report_beside(fit, out, quiet=as_json)
    if stopped:
        say("Stopped; this is the best so far. Add --resume to go on.")
        raise typer.Exit(130)
    if not fit.horizon.answered:
        raise typer.Exit(1)


def _steps(horizon: str) -> int | None:
    if horizon == "auto":
        return None
    try:
        return int(horizon)
    except ValueError as error:
        raise InputError(
            f"--horizon must be auto or a whole number of steps >= 1, got {horizon}."
        ) from error


def _checkpoint(out: Path, resume: bool) -> Checkpoint:
    path = out / "fit" / "checkpoint.json"
    if resume and not path.exists():
        say(f"note: {path} is missing, so nothing is resumed; beginning anew.")
    return Checkpoint(path, resume and path.exists())
