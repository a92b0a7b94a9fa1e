"""The command ``penode check``."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer
from rich.text import Text

from penode.cli.console import Row, print_rows
from penode.cli.options import load_studies, require_png
from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.horizon.identifiability import THRESHOLD
from penode.pmsm.machine.terms import ANGLE
from penode.pmsm.points.check import PointsCheck, check_points
from penode.pmsm.points.operating_points import load_runs
from penode.pmsm.precheck.excitation import QUARTERS
from penode.pmsm.recording.drive_mapping import TORQUE
from penode.pmsm.recording_check import RecordingCheck, check_recordings
from penode.report.quantities import number
from penode.report.uncertainty_budget import MINOR, size_text

#: Half width of R by the balance alone, as a part of it, from which training mostly cannot help.
_USABLE = 0.25
_NOT_DRAWN = "not drawn: what the recordings cover shows once they can be used"


def check_command(
    runs: list[Path],
    config: list[Path] | None,
    picture: Path | None,
    pole_pairs: int | None,
    as_json: bool,
) -> None:
    """Check what recordings determine and what they cannot, before any training: a few seconds."""
    require_png(picture)
    asked = load_studies(config, {} if pole_pairs is None else {"pole_pairs": pole_pairs})
    recordings, alone = load_runs(runs, asked.mapping)
    if alone is not None:
        _print_points(check_points(alone, asked.study), picture, as_json)
        return
    check = check_recordings(recordings, asked.study)
    asked_for = picture
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
        drawn_rows = [("picture", str(picture or _NOT_DRAWN))] if asked_for else []
        print_rows([*rows, ("verdict", verdict), *drawn_rows])
    if not check.good:
        raise typer.Exit(1)


def _print_points(check: PointsCheck, picture: Path | None, as_json: bool) -> None:
    """Print what operating points determine, and end with the command's status."""
    if picture is not None:
        raise InputError(
            f"--picture must be left out for a table of operating points, got {picture}; the "
            "report of penode identify shows them."
        )
    if as_json:
        typer.echo(json.dumps(check.as_json()))
    else:
        torque = ", with the torque" if TORQUE in check.points.channels else ""
        count = f"{check.points.name}: {len(check.points)} operating points{torque}"
        verdict = Text(check.fit.horizon.reason, style="green" if check.good else "red")
        print_rows(
            [
                ("points", count),
                *(("coverage", sentence) for sentence in check.coverage),
                ("R", f"± {number(100 * check.half_width)} % from these points"),
                *(
                    ("would bring", f"R ± {number(100 * half)} %: {what}")
                    for what, half in check.would_bring.items()
                ),
                ("verdict", verdict),
            ]
        )
    if not check.good:
        raise typer.Exit(1)


def _recordings(check: RecordingCheck) -> list[Row]:
    """Return what stands in the recordings, and which conventions are broken."""
    quality = [f.sentence for f in check.quality] or [
        "No voltage, current or angle stands still or is clipped."
    ]
    angle = all(ANGLE.name in one.channels for one in check.recordings)
    tested = "Signs, units, order, timing and angle" if angle else "Signs, units and order"
    but = ", but for what is undetermined below" if check.undetermined else ""
    conventions = [b.sentence for b in check.broken] or [
        f"{tested} of the channels agree with physics{but}."
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
    speeds = ", ".join(dict.fromkeys(number(s / (2 * np.pi)) for s in cover.speeds))
    summary = (
        f"Currents up to {number(cover.largest_current)} A, peak; around what was recorded a hull "
        f"has {number(100 * cover.fraction, 2)} % of the disc of that radius. Electrical frequency "
        f"{speeds} Hz."
    )
    parts = zip(cover.quarters, QUARTERS, strict=True)
    visited = ", ".join(f"{number(100 * part, 2)} % at {name}" for part, name in parts)
    sentences = (summary, f"Samples by quarter: {visited}.", *cover.advice)
    return [("coverage", sentence) for sentence in sentences]


def _identifiability(check: RecordingCheck) -> list[Row]:
    if check.identifiability is None:
        return []
    judged = check.identifiability
    named = judged.independence.items()
    shares = ", ".join(f"{100 * rho:.2g} % of the voltage of {name}" for name, rho in named)
    summary = (
        f"No {judged.flux_map} map can imitate {shares}; from {100 * THRESHOLD:g} % on each can be "
        "determined."
    )
    told = filter(None, (summary, judged.alarm, judged.repair and f"Repair: {judged.repair}"))
    return [
        *(("identifiability", sentence) for sentence in told),
        *_expected(check),
        *(("model", reason) for reason in check.structure),
    ]


def _expected(check: RecordingCheck) -> list[Row]:
    """Return how sure R will be, where it can be distinguished at all."""
    if check.expected is None or not check.good:
        return []
    best, balance = (number(100 * half, 2) for half in check.half_widths)
    sensors = [row for row in check.expected.budget if row.origin in ("assumed", "declared")]
    main = [row for row in sensors if row.std >= MINOR * sensors[0].std > 0]
    named = ", ".join(f"{row.source} {size_text(row)}" for row in main)
    by_sensors = (
        f"at best ± {best} % (95 %), which the sensors allow (std: {named})"
        if main
        else "no error of the sensors is assumed"
    )
    before = (
        ""
        if check.half_widths[1] < _USABLE
        else (
            f" Before training the recording shows R to ± {balance} % only; where training leaves "
            "much of that, record another speed, longer, or larger currents."
        )
    )
    said = f"R: {by_sensors}; training shows how much of it these recordings reach.{before}"
    return [("expected", said)]
