"""The command ``penode simulate``."""

import time
from pathlib import Path

from penode.bench.config import load_config
from penode.bench.run import Recording
from penode.cli.console import Row, print_rows, say
from penode.cli.options import require_png
from penode.data.experiment import Experiment
from penode.data.save import require_suffix as require_table_suffix
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.simulation.simulated_drive import Deviation, deviation, share_beyond, torque_of
from penode.pmsm.simulation.simulated_files import truth_file, write_recording
from penode.pmsm.study_file import load_study
from penode.report.quantities import number


def simulate_command(
    config: str,
    out: Path,
    picture: Path | None,
    over_time: Path | None,
    against: Path | None,
    study: Path | None,
) -> None:
    """Record a run on the simulated bench, with the truth written beside it."""
    require_table_suffix(out)
    require_png(picture, over_time)
    replaced = _replaced(out)
    recorded = _recorded(against, study)
    began = time.monotonic()
    simulation = load_config(config)
    for warning in simulation.warnings:
        say(f"warning: {warning}")
    recording = simulation.record()
    rows: list[Row] = []
    if over_time is not None:
        rows.append(("torque", _torque(recording)))
    if recorded is not None:
        rows += _deviation_rows(deviation(recording, recorded))
    story, table = write_recording(recording, out)
    # Imported here: the plotting library takes a third of a second, and nothing else uses it.
    if picture is not None:
        from penode.pmsm.simulation.recording_picture import recording_picture

        write_atomically(picture, recording_picture(recording))
        rows.append(("picture", str(picture)))
    if over_time is not None:
        from penode.pmsm.simulation.drive_picture import drive_picture

        write_atomically(over_time, drive_picture(recording, recorded))
        rows.append(("picture", str(over_time)))
    run, took = recording.experiment, time.monotonic() - began
    told = f"{out}{replaced}: {len(run) * run.time_step:.3g} s of {run.name}, in {took:.1f} s"
    print_rows([("recording", told), ("truth", str(story)), ("true map", str(table)), *rows])
    share = 0.0 if simulation.result is None else share_beyond(recording, simulation.result)
    if share > 0:
        say(
            f"warning: in {number(100 * share, 2)} % of the run the currents are where no "
            "recording has been, and the map is an extrapolation."
        )


def _replaced(out: Path) -> str:
    """Return what is said where an earlier simulation is replaced; nothing else ever is."""
    if not out.exists():
        return ""
    if not truth_file(out).exists():
        raise InputError(
            f"{out} was not written by a simulation, which would replace it: give another --out."
        )
    return " (replaced)"


def _recorded(against: Path | None, study: Path | None) -> Experiment | None:
    if against is None and study is not None:
        raise InputError("--study needs --against; name the recording whose columns it maps.")
    return None if against is None else drive_recording(load_study(study).load(against))


def _torque(recording: Recording) -> str:
    torque = torque_of(recording)
    low, mean, high = (number(float(x)) for x in (torque.min(), torque.mean(), torque.max()))
    return f"{mean} Nm in the mean, {low} to {high} Nm"


def _deviation_rows(apart: Deviation) -> list[Row]:
    rms = {name: number(value) for name, value in apart.rms.items()}
    settled = number(1e3 * apart.settled)
    currents = f"i_d {rms['i_d']} A, i_q {rms['i_q']} A rms from {apart.name}, after {settled} ms"
    return [
        ("currents", currents),
        ("voltages", f"u_d {rms['u_d']} V, u_q {rms['u_q']} V rms from it"),
    ]
