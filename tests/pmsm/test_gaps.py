"""Recordings of a drive whose logger paused: read, checked and identified by stretches."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from penode import Fit
from penode.bench.drive import Drive
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli.main import app
from penode.pmsm.balance.usable import usable_stretches
from penode.pmsm.conventions.check import judge
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.study_settings import Study

STUDY = Study(hold="dq")
LOST = ((3000, 3400), (5601, 5602), (5700, 6000))


@pytest.fixture(scope="module")
def run():
    reference = Lissajous(240.0, 50.0, 43.0)
    drive = Drive(current_noise=0.3)
    return simulate(TRACTION_300A, reference, speed_rpm=1000.0, duration=1.0, drive=drive, seed=1)


@pytest.fixture(scope="module")
def paused(run, tmp_path_factory):
    """The file of a logger that lost three blocks."""
    kept = np.ones(len(run), dtype=bool)
    for first, last in LOST:
        kept[first:last] = False
    path = tmp_path_factory.mktemp("paused") / "paused.csv"
    columns = np.column_stack([np.arange(len(run)) * run.time_step, *run.channels.values()])
    header = ",".join(["t", *run.channels])
    np.savetxt(path, columns[kept], delimiter=",", header=header, comments="", fmt="%.10g")
    return path


@pytest.mark.slow
def test_a_recording_with_gaps_is_identified_and_the_result_says_so(paused, tmp_path):
    arguments = ["identify", str(paused), "--out", str(tmp_path / "out"), "--horizon", "1"]
    shown = CliRunner().invoke(app, [*arguments, "--no-inverter"])
    assert shown.exit_code == 0, shown.output
    said = (
        "paused.csv: 3 gaps of 0.0001 to 0.04 s in time, after data rows 3000, 5201, 5299: read as "
        "3 stretches, and nothing is predicted across a gap. 98 samples that are fewer than 200 in "
        "a row are left out."
    )
    assert said in shown.output
    assert "3 stretches of paused.csv: RMSE one step from a noisy sample" in shown.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    low, high = result["parameters"]["R"]["interval_95"]
    assert low < TRACTION_300A.resistance < high
    assert high - low < 0.05 * TRACTION_300A.resistance
    assert list(result["metrics"]["train"]) == ["paused.csv"]
    assert list(result["provenance"]["data"]) == ["paused.csv"]
    assert said in result["provenance"]["structure"]
    assert said in (tmp_path / "out" / "report.html").read_text()
    fit = Fit.load(tmp_path / "out")
    assert [len(c.measured) for c in fit.comparisons] == [3000, 2201, 4000]
    assert fit.spectrum.recording == "paused.csv rows 5300 to 9299"  # the longest


def test_a_check_says_it_and_judges_the_stretches(paused):
    shown = CliRunner().invoke(app, ["check", str(paused), "--json"])
    found = json.loads(shown.stdout)
    assert shown.exit_code == 0
    assert found["good"]
    assert [r["samples"] for r in found["recordings"]] == [3000, 2201, 4000]
    assert "read as 3 stretches" in found["used"][0]


def test_conventions_of_short_stretches_are_what_most_of_them_say(run):
    """Of stretches of this length every tenth would be called broken by itself."""
    short = [(first, first + 700) for first in range(0, 9000, 1000)]
    judged, _ = judge([run.part(*span) for span in short], **STUDY.conventions)
    assert judged.broken == ()
    assert (
        "no stretch has 2000 samples; conventions are what most of the 5" in judged.undetermined[-1]
    )
    turned = replace(run, channels={**run.channels, "i_q": -run.channels["i_q"]})
    judged, _ = judge([turned.part(*span) for span in short], **STUDY.conventions)
    assert [b.name for b in judged.broken] == ["negative q current"]
    judged, _ = judge([turned.part(0, 700), turned.part(1000, 5000)], **STUDY.conventions)
    assert [b.name for b in judged.broken] == ["negative q current"]
    assert not any("no stretch has" in sentence for sentence in judged.undetermined)


def test_stretches_in_which_the_drive_rests_are_left_out(run):
    channels = dict(run.channels)
    for name in ("i_d", "i_q"):
        channels[name] = np.where(np.arange(len(run)) < 1500, 0.0, channels[name])
    rests = replace(run, channels=channels)
    stretches = [rests.part(0, 600), rests.part(700, 1400), rests.part(2000, 9000)]
    (kept,) = usable_stretches(stretches)
    assert kept.name == stretches[2].name
    assert "Left out: " in kept.place.reasons[0]
    assert "channel i_d is constant at 0 in all 600 samples" in kept.place.reasons[0]
    assert "1 more" in kept.place.reasons[0]
    assert usable_stretches(stretches[:2]) == tuple(stretches[:2])


def test_a_rotor_that_turns_slowly_does_not_stand_still_in_short_stretches(run):
    slow = replace(run, channels={**run.channels, "omega_el": np.full(len(run), 3.0)})
    stretches = [slow.part(first, first + 1000) for first in range(0, 9000, 1500)]
    assert stands_still(stretches[:1])
    assert not stands_still(stretches)
