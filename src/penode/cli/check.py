"""The command ``penode check``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.text import Text

from penode.cli.console import Row, print_rows
from penode.cli.options import Config, Json, Recordings, require_png
from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.fit.archive import write_atomically
from penode.pmsm.recording_check import RecordingCheck, check_recordings
from penode.pmsm.study_file import load_study
from penode.report.quantities import number


def check_command(
    runs: Recordings,
    config: Config = None,
    picture: Annotated[Path | None, typer.Option(help="PNG of what is covered.")] = None,
    as_json: Json = False,
) -> None:
    """Check what recordings determine and what they cannot, before any training: a few seconds.

    Quality of the channels, their conventions tested against physics, what currents and speeds
    cover, and how far the resistance can be distinguished from the map.

    Exit status: 0 all is well, 1 a convention is broken or the data cannot answer, 2 bad input.

    Example: penode check run.csv --picture cover.png
    """
    require_png(picture)
    asked = load_study(config)
    check = check_recordings(
        [stretch for run in runs for stretch in asked.load_stretches(run)],
        asked.study,
    )
    if check.excitation is None or check.identifiability is None:
        picture = None
    elif picture is not None:
        # Imported here: the plotting library takes a third of a second, and few commands draw.
        from penode.pmsm.precheck.check_picture import check_picture

        drawn = check_picture(check.drives, check.excitation, check.identifiability)
        write_atomically(picture, drawn)
    if as_json:
        typer.echo(json.dumps({**check.as_json(), "picture": picture and str(picture)}))
    else:
        verdict = Text(check.verdict, style="green" if check.good else "red")
        rows = [*_recordings(check), *_coverage(check), *_identifiability(check)]
        drawn_rows = [("picture", str(picture))] if picture else []
        print_rows([*rows, ("verdict", verdict), *drawn_rows])
    if not check.good:
        raise typer.Exit(1)


def _recordings(check: RecordingCheck) -> list[Row]:
    """Return what stands in the recordings, and which conventions are broken."""
    quality = [f.sentence for f in check.quality] or [
        "No voltage, current or angle stands still or is clipped."
    ]
    conventions = [b.sentence for b in check.broken] or [
        "Signs, units, order, timing and angle of the channels agree with physics."
    ]
    return [
        *(("recording", _recording(each)) for each in by_recording(check.recordings)),
        *(("quality", sentence) for sentence in quality),
        *(("used", sentence) for sentence in check.sentences),
        *(("conventions", sentence) for sentence in conventions),
        *(("undetermined", sentence) for sentence in check.undetermined),
    ]


def _recording(stretches: Sequence[Experiment]) -> str:
    samples, first = sum(map(len, stretches)), stretches[0]
    time, rate = number(samples * first.time_step), number(1e-3 / first.time_step)
    pieces = f", in {len(stretches)} stretches" if len(stretches) > 1 else ""
    return f"{first.place.recording}: {samples} samples in {time} s, {rate} kHz{pieces}"


def _coverage(check: RecordingCheck) -> list[Row]:
    if check.excitation is None:
        return []
    cover = check.excitation
    speeds = ", ".join(dict.fromkeys(number(s * 30 / np.pi) for s in cover.speeds))
    summary = (
        f"Currents up to {number(cover.largest_current)} A over {number(100 * cover.fraction)} % "
        f"of that disc; the current vector changes at up to {number(cover.current_rate)} rad/s; "
        f"electrical speed {speeds} rpm."
    )
    return [("coverage", sentence) for sentence in (summary, *cover.advice)]


def _identifiability(check: RecordingCheck) -> list[Row]:
    if check.identifiability is None:
        return []
    judged = check.identifiability
    rhos = ", ".join(f"{name} {rho:.2g}" for name, rho in judged.independence.items())
    summary = (
        f"Independence with the {judged.flux_map} map: {rhos} "
        "(1: nothing in the map looks like it; below 0.01: not identifiable)."
    )
    told = filter(None, (summary, judged.alarm, judged.repair and f"Repair: {judged.repair}"))
    return [
        *(("identifiability", sentence) for sentence in told),
        *(("model", reason) for reason in check.structure),
    ]
