"""The command ``penode simulate``."""

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from penode.bench.config import Simulation, load_config
from penode.bench.run import Recording
from penode.cli.completion import simulations
from penode.cli.options import require_png
from penode.data.experiment import Experiment
from penode.data.save import require_suffix
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.simulation.simulated_drive import Deviation, deviation, share_beyond, torque_of
from penode.pmsm.simulation.simulated_files import write_recording
from penode.pmsm.study_file import load_study
from penode.report.quantities import number

_output, _errors = Console(), Console(stderr=True)


def simulate_command(
    config: Annotated[
        str,
        typer.Argument(help="TOML file, or the name of a shipped one.", autocompletion=simulations),
    ],
    out: Annotated[Path, typer.Option(help="Recording to write, .csv or .parquet.")],
    picture: Annotated[
        Path | None, typer.Option(help="PNG to write as well: trajectory and spectra.")
    ] = None,
    over_time: Annotated[
        Path | None, typer.Option(help="PNG to write as well: currents, voltages, torque.")
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(help="Recording on the same reference, to hold the simulation against."),
    ] = None,
    study: Annotated[
        Path | None, typer.Option(help="Study file that maps the columns of --against.")
    ] = None,
) -> None:
    """Record a run on the simulated bench, with the truth written beside it.

    Shipped: paper_simulation, paper_testbench, well_designed. In a TOML file of your own the
    machine may be a built-in one, a flux map in a file, or what penode identify wrote.

    Example: penode simulate paper_testbench --out run.csv

    Example: penode simulate drive.toml --out drive.csv --over-time drive.png --against run.csv
    """
    require_suffix(out)
    require_png(picture, over_time)
    recorded = _recorded(against, study)
    began = time.monotonic()
    simulation = load_config(config)
    for warning in simulation.warnings:
        _say(f"warning: {warning}")
    recording = simulation.record()
    apart = None if recorded is None else deviation(recording, recorded)
    story, table = write_recording(recording, out)
    # Imported here: the plotting library takes a third of a second, and nothing else uses it.
    if picture is not None:
        from penode.pmsm.simulation.recording_picture import recording_picture

        write_atomically(picture, recording_picture(recording))
    if over_time is not None:
        from penode.pmsm.simulation.drive_picture import drive_picture

        write_atomically(over_time, drive_picture(recording, recorded))
    seconds = len(recording.experiment) * recording.experiment.time_step
    took = time.monotonic() - began
    lines = [
        f"recording  {out}: {seconds:.3g} s of {recording.experiment.name}, in {took:.1f} s",
        f"truth      {story}",
        f"true map   {table}",
        *([] if over_time is None else [_torque_line(recording)]),
        *([] if apart is None else _deviation_lines(apart)),
        *(f"picture    {path}" for path in (picture, over_time) if path is not None),
    ]
    _output.print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)
    _warn_beyond(simulation, recording)


def _recorded(against: Path | None, study: Path | None) -> Experiment | None:
    if against is None and study is not None:
        raise InputError("--study came without --against; name the recording that it maps.")
    return None if against is None else drive_recording(load_study(study).load(against))


def _torque_line(recording: Recording) -> str:
    torque = torque_of(recording)
    low, mean, high = (
        number(float(value)) for value in (torque.min(), torque.mean(), torque.max())
    )
    return f"torque     {mean} Nm in the mean, {low} to {high} Nm"


def _deviation_lines(apart: Deviation) -> list[str]:
    rms = {name: number(value) for name, value in apart.rms.items()}
    return [
        f"currents   i_d {rms['i_d']} A, i_q {rms['i_q']} A rms from {apart.name}, "
        f"after {number(1e3 * apart.settled)} ms",
        f"voltages   u_d {rms['u_d']} V, u_q {rms['u_q']} V rms from it",
    ]


def _warn_beyond(simulation: Simulation, recording: Recording) -> None:
    """Say how much of the run rests on an extrapolated map."""
    if simulation.result is None:
        return
    share = share_beyond(recording, simulation.result)
    if share > 0:
        _say(
            f"warning: in {number(100 * share, 2)} % of the run the currents are where no "
            "recording has been, and the map is an extrapolation."
        )


def _say(text: str) -> None:
    _errors.print(text, soft_wrap=True, highlight=False, markup=False)
