"""The command, on a small study and, slowly, on all of them."""

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import record
from penode.cli.console import Interrupted
from penode.cli.main import app, main
from penode.paper.conventional.linear_maps import polynomial
from penode.paper.conventional.linear_methods import FluxPredictor
from penode.paper.studies import runs as runs_module
from penode.paper.studies.panels import Claim, Panel, Series, StudyResult
from penode.paper.studies.recordings import Case
from penode.paper.studies.reproduce import STUDIES
from penode.paper.studies.summaries import error_percent, row


@pytest.fixture
def small(monkeypatch):
    """A study of two degrees of a polynomial on 0.1 s."""
    reference = Lissajous(150.0, 90.0, 99.0)
    recording = record(TRACTION_300A, reference, speed_rpm=300.0, duration=0.1)
    case = Case("simulation", "short", recording, ())
    monkeypatch.setattr(runs_module, "record_case", lambda name, extent: replace(case, name=name))

    def study(runs):
        degrees = (1, 3)
        found = [
            runs.by_method(
                "simulation", f"degree{n}", FluxPredictor(polynomial(n, reciprocal=True)).identify
            )
            for n in degrees
        ]
        errors = [error_percent(run.result) for run in found]
        better = abs(errors[1]) < abs(errors[0])
        panel = Panel("R", "degree", "error (%)", (Series("flux", degrees, errors, "ours"),), 0.0)
        claims = (Claim("Three degrees are better than one.", better, f"{errors} %"),)
        rows = [row(run) for run in found]
        return StudyResult("small", "Small", "?", rows, (panel,), claims, ".", ("method", "R_mohm"))

    monkeypatch.setitem(STUDIES, "small", study)


def test_a_small_study_from_the_command_to_the_page(small, tmp_path):
    command = ["reproduce", "small", "--out", str(tmp_path), "--quick"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert "statements hold" not in done.output
    assert "quick numbers prove nothing, and its statements are not judged" in done.output
    page = (tmp_path / "results.md").read_text()
    assert "- **Not judged.** Three degrees are better than one." in page
    rows = json.loads((tmp_path / "small.json").read_text())["rows"]
    assert [r["method"] for r in rows] == ["degree1", "degree3"]
    assert abs(rows[1]["R_mohm"] - 10.0) < 0.5
    before = (tmp_path / "runs/simulation/degree3/seed0/H0/run.json").stat().st_mtime_ns
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 0
    after = (tmp_path / "runs/simulation/degree3/seed0/H0/run.json").stat().st_mtime_ns
    assert after == before  # taken over, not trained again


def test_an_unknown_study_is_told_in_one_sentence(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(
        sys, "argv", ["penode", "reproduce", "figure3", "--out", str(tmp_path / "x")]
    )
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert "study must be all or one of" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_ctrl_c_says_that_the_same_command_goes_on(monkeypatch, tmp_path):
    def stopped(runs):
        raise KeyboardInterrupt

    monkeypatch.setitem(STUDIES, "small", stopped)
    done = CliRunner().invoke(app, ["reproduce", "small", "--out", str(tmp_path)])
    assert isinstance(done.exception, Interrupted)
    assert "the same command goes on" in str(done.exception)


@pytest.mark.slow
def test_all_studies_run_quickly(tmp_path):
    program, began = Path(sys.executable).with_name("penode"), time.monotonic()
    subprocess.run(
        [program, "reproduce", "all", "--out", tmp_path, "--quick"], check=True, timeout=900
    )
    took = time.monotonic() - began
    for name in STUDIES:
        assert (tmp_path / f"{name}.csv").read_text().count("\n") > 1
        assert (tmp_path / "figures" / f"studies_{name}.png").stat().st_size > 10_000
    assert took < 180, f"{took:.0f} s; 3 min on two idle cores were wanted"
