"""The command line: exit status 0 done, 1 the data cannot answer, 2 bad input, 130 stopped."""

import hashlib
import platform
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import jax
import typer
from rich.console import Console

from penode.cli.check import check_command
from penode.cli.compare import compare_command
from penode.cli.export import export_command
from penode.cli.init import init_command
from penode.cli.loci import loci_command
from penode.cli.progress import Interrupted, watched
from penode.cli.summary import print_demo, print_fit
from penode.data.save import require_suffix
from penode.errors import InputError
from penode.horizon.checkpoint import Checkpoint
from penode.identify import Stopped
from penode.pmsm.bench.config import load_config
from penode.pmsm.demo import run_demo
from penode.pmsm.flux_maps import FLUX_MAPS
from penode.pmsm.holds import HOLDS
from penode.pmsm.report import machine_report
from penode.pmsm.simulated_files import write_recording
from penode.pmsm.study import PURPOSES, identify, write
from penode.pmsm.study_file import load_study
from penode.training.archive import write_atomically
from penode.training.fit import Fit

app = typer.Typer(
    help="Find the flux-linkage map and the resistance of a PMSM from an ordinary recording.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Folder = Annotated[Path, typer.Option("--out", help="Folder for the results; made if absent.")]


def main() -> None:
    """Run the command line; bad input is told in one sentence."""
    _use_compilation_cache()
    try:
        app()
    except InputError as error:
        _say(f"error: {error}")
        sys.exit(2)
    except Interrupted as stop:
        _say(str(stop))
        sys.exit(130)


@app.command("identify")
def identify_command(  # noqa: PLR0913 (an argument an option)
    runs: Annotated[
        list[Path], typer.Argument(help="Recordings to train on: csv, parquet, mat, mf4, tdms.")
    ],
    out: Folder,
    validate: Annotated[
        list[Path] | None, typer.Option(help="Recording to predict, not to train on. Repeatable.")
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(help="Study file: columns, units, options. penode init writes one."),
    ] = None,
    horizon: Annotated[
        str | None, typer.Option(help="auto, or the number of steps.", show_default="auto")
    ] = None,
    flux_map: Annotated[
        str | None,
        typer.Option(help=f"One of {', '.join(FLUX_MAPS)}.", show_default="coenergy"),
    ] = None,
    inverter: Annotated[
        bool | None,
        typer.Option(
            help="Identify the inverter's dead-time voltage; needs theta_el.",
            show_default="decided from the data",
        ),
    ] = None,
    angle_orders: Annotated[
        str | None,
        typer.Option(
            help="Harmonics of the angle in the map, such as 6,12, or none; they need theta_el.",
            show_default="decided from the data",
        ),
    ] = None,
    hold: Annotated[
        str | None,
        typer.Option(
            help=f"Frame in which the voltage is held: {' or '.join(HOLDS)}.", show_default="dq"
        ),
    ] = None,
    purpose: Annotated[
        str | None,
        typer.Option(
            help=f"What the horizon is chosen for: {', '.join(PURPOSES)}.",
            show_default="parameters",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of every random draw.", show_default="0")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the fit that was stopped in --out.")
    ] = False,
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
    options = {
        "flux_map": flux_map,
        "seed": seed,
        "inverter": inverter,
        "angle_orders": None if angle_orders is None else _orders(angle_orders),
        "hold": hold,
        "purpose": purpose,
    }
    given = {name: option for name, option in options.items() if option is not None}
    asked = load_study(config, given if horizon is None else {**given, "horizon": _steps(horizon)})
    checkpoint = _checkpoint(out, resume)
    stopped = False
    with watched(out, _errors, checkpoint) as observer:
        try:
            fit = identify(
                [asked.load(run) for run in runs],
                study=asked.study,
                validation=[asked.load(run) for run in validate or []],
                observer=observer,
                checkpoint=checkpoint,
            )
        except Stopped as stop:
            fit, stopped = stop.fit, True
        fit = _signed(fit, began)
        write(fit, out)
    print_fit(_output, fit, out)
    if stopped:
        _say("Stopped; this is the best so far. Add --resume to go on.")
        raise typer.Exit(130)
    checkpoint.path.unlink(missing_ok=True)
    if not fit.horizon.answered:
        raise typer.Exit(1)


app.command("init")(init_command)
app.command("check")(check_command)


@app.command()
def demo(out: Folder = Path("penode-demo")) -> None:
    """Show the whole story on the built-in machine: record, identify, compare with the truth."""
    began = time.monotonic()
    _say("Recording the built-in machine on the simulated bench ...")
    with watched(out, _errors) as observer:
        story = run_demo(out / "recordings", observer)
    story = replace(story, fit=_signed(story.fit, began))
    write(story.fit, out)
    print_fit(_output, story.fit, out)
    print_demo(_output, story)


@app.command()
def simulate(
    config: Annotated[str, typer.Argument(help="TOML file, or the name of a shipped one.")],
    out: Annotated[Path, typer.Option(help="Recording to write, .csv or .parquet.")],
    picture: Annotated[Path | None, typer.Option(help="PNG to write as well.")] = None,
) -> None:
    """Record a run on the simulated bench, with the truth written beside it.

    Shipped: paper_simulation, paper_testbench, well_designed.

    Example: penode simulate paper_testbench --out run.csv
    """
    require_suffix(out)
    began = time.monotonic()
    simulation = load_config(config)
    for warning in simulation.warnings:
        _say(f"warning: {warning}")
    recording = simulation.record()
    story, table = write_recording(recording, out)
    if picture is not None:
        # Imported here: the plotting library takes a third of a second, and nothing else uses it.
        from penode.pmsm.recording_picture import recording_picture

        write_atomically(picture, recording_picture(recording))
    seconds = len(recording.experiment) * recording.experiment.time_step
    took = time.monotonic() - began
    lines = (
        f"recording  {out}: {seconds:.3g} s of {recording.experiment.name}, in {took:.1f} s",
        f"truth      {story}",
        f"true map   {table}",
    )
    _output.print("\n".join(lines), soft_wrap=True, highlight=False)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="Folder that identify or demo wrote.")],
) -> None:
    """Write report.html again from a saved fit."""
    page = folder / "report.html"
    write_atomically(page, machine_report(Fit.load(folder)))
    _output.print(f"report  {page}", soft_wrap=True, highlight=False)


app.command("export")(export_command)
app.command("loci")(loci_command)
app.command("compare")(compare_command)

_output = Console()
_errors = Console(stderr=True)


def _say(text: str) -> None:
    _errors.print(text, soft_wrap=True, highlight=False, markup=False)


def _steps(horizon: str) -> int | None:
    if horizon == "auto":
        return None
    try:
        return int(horizon)
    except ValueError as error:
        raise InputError(
            f"--horizon {horizon} came; give auto or a whole number of steps from 1."
        ) from error


def _orders(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(",")) if text not in ("", "none") else ()
    except ValueError as error:
        raise InputError(
            f"--angle-orders {text} came; give none, or whole numbers with commas, such as 6,12."
        ) from error


def _checkpoint(out: Path, resume: bool) -> Checkpoint:
    path = out / "fit" / "checkpoint.json"
    if resume and not path.exists():
        _say(f"note: {path} is not there, so nothing is resumed; beginning anew.")
    return Checkpoint(path, resume and path.exists())


def _signed(fit: Fit, began: float) -> Fit:
    """Add the command and its wall time to the provenance."""
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
    facts = {"command": command, "wall_time_s": round(time.monotonic() - began, 2)}
    return replace(fit, provenance={**fit.provenance, **facts})


def _use_compilation_cache() -> None:
    """Keep compiled programs between runs, apart for each processor; the cache is best effort."""
    with suppress(OSError, ValueError):
        processor = f"{platform.machine()} {platform.processor()} {_processor_flags()}"
        key = hashlib.sha256(f"{processor} {jax.__version__}".encode()).hexdigest()[:16]
        folder = Path.home() / ".cache" / "penode" / "compiled" / key
        folder.mkdir(parents=True, exist_ok=True)
        configure: Callable[[str, object], None] = jax.config.update
        configure("jax_compilation_cache_dir", str(folder))
        configure("jax_persistent_cache_min_compile_time_secs", 0.0)


def _processor_flags() -> str:
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    return next((line for line in lines if line.startswith("flags")), "")
