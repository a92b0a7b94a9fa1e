"""The command ``penode check``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from penode.cli.rows import print_rows
from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.pmsm.recording_check import RecordingCheck, check_recordings
from penode.pmsm.study_file import load_study
from penode.report.quantities import number

_output = Console()


def check_command(
    runs: Annotated[
        list[Path], typer.Argument(help="Recordings to check: csv, parquet, mat, mf4, tdms.")
    ],
    config: Annotated[
        Path | None, typer.Option(help="Study file: columns, units, options, name plate.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG of what is covered.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document instead.")] = False,
) -> None:
    """Check what recordings determine and what they cannot, before any training: a few seconds.

    Quality of the channels, their conventions tested against physics, what currents and speeds
    cover, and how far the resistance can be distinguished from the map.

    Exit status: 0 all is well, 1 a convention is broken or the data cannot answer, 2 bad input.

    Example: penode check run.csv --picture cover.png
    """
    if picture is not None and picture.suffix.lower() != ".png":
        raise InputError(f"{picture}: suffix {picture.suffix!r} came; use .png.")
    asked = load_study(config)
    check = check_recordings(
        [stretch for run in runs for stretch in asked.load_stretches(run)],
        asked.study,
    )
    drawn = picture is not None and check.excitation is not None
    if picture is not None and check.excitation is not None and check.identifiability is not None:
        # Imported here: the plotting library takes a third of a second, and few commands draw.
        from penode.pmsm.precheck.check_picture import check_picture

        write_atomically(
            picture, check_picture(check.drives, check.excitation, check.identifiability)
        )
    if as_json:
        typer.echo(json.dumps({**check.as_json(), "picture": str(picture) if drawn else None}))
    else:
        _print(check, picture if drawn else None)
    if not check.good:
        raise typer.Exit(1)


def _print(check: RecordingCheck, picture: Path | None) -> None:
    verdict = Text(check.verdict, style="green" if check.good else "red")
    rows: list[tuple[str, str | Text]] = [
        *_recordings(check),
        *_conventions(check),
        *_coverage(check),
        *_identifiability(check),
        ("verdict", verdict),
    ]
    if picture is not None:
        rows.append(("picture", str(picture)))
    print_rows(_output, rows)


def _recordings(check: RecordingCheck) -> list[tuple[str, str]]:
    rows = [("recording", _recording(each)) for each in by_recording(check.recordings)]
    quality = [f.sentence for f in check.quality] or ["No channel stands still or is clipped."]
    rows += [("quality", sentence) for sentence in quality]
    return rows + [("used", sentence) for sentence in check.sentences]


def _recording(stretches: Sequence[Experiment]) -> str:
    samples, first = sum(map(len, stretches)), stretches[0]
    time, rate = number(samples * first.time_step), number(1e-3 / first.time_step)
    pieces = f", in {len(stretches)} stretches" if len(stretches) > 1 else ""
    return f"{first.place.recording}: {samples} samples in {time} s, {rate} kHz{pieces}"


def _conventions(check: RecordingCheck) -> list[tuple[str, str]]:
    sentences = [b.sentence for b in check.broken] or [
        "Nothing speaks against the signs, units, order, timing and angle of the channels."
    ]
    return [("conventions", sentence) for sentence in sentences] + [
        ("undetermined", sentence) for sentence in check.undetermined
    ]


def _coverage(check: RecordingCheck) -> list[tuple[str, str]]:
    if check.excitation is None:
        return []
    cover = check.excitation
    speeds = ", ".join(dict.fromkeys(number(s * 30 / np.pi) for s in cover.speeds))
    summary = (
        f"Currents up to {number(cover.largest_current)} A over {number(100 * cover.fraction)} % "
        f"of that disc, moving at up to {number(cover.current_rate)} rad/s; speed {speeds} rpm "
        f"electrical."
    )
    return [("coverage", sentence) for sentence in (summary, *cover.advice)]


def _identifiability(check: RecordingCheck) -> list[tuple[str, str]]:
    if check.identifiability is None:
        return []
    judged = check.identifiability
    rhos = ", ".join(f"{name} {rho:.2g}" for name, rho in judged.independence.items())
    summary = (
        f"Independence with the {judged.flux_map} map: {rhos} "
        "(1 its own, below 0.01 not identifiable)."
    )
    rows = [
        ("identifiability", s)
        for s in (summary, judged.alarm, judged.repair and f"Repair: {judged.repair}")
    ]
    return [row for row in rows if row[1]] + [("model", reason) for reason in check.structure]
