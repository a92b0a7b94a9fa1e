"""The answer is written before its report; what of the report fails is left out by name."""

import json
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from tests.cli.conftest import without_progress

from penode import Fit
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli import identify as command_line
from penode.data.save import save
from penode.horizon import objections
from penode.identify import Stopped
from penode.pmsm import identify, load_study

QUICK = ("--horizon", 3, "--no-inverter", "--angle-orders", "none")
WHOLE = {"fit/fit.json", "fit/fit.npz", "flux_map.csv", "result.json"}


@pytest.fixture(autouse=True)
def details(monkeypatch, tmp_path):
    folder = tmp_path / "details"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.csv"
    reference = Lissajous(240.0, 50.0, 54.0)
    save(simulate(TRACTION_300A, reference, speed_rpm=1500.0, duration=0.4), path)
    return path


@pytest.fixture
def identified(run, penode, tmp_path):
    """Return the command over the recording, into a folder."""

    def command(*options):
        return penode("identify", run, *QUICK, "--out", tmp_path / "out", *options)

    command.out = tmp_path / "out"
    return command


@pytest.fixture(scope="module")
def saved(run, tmp_path_factory):
    """Return a folder with the fit of the recording and no report."""
    folder = tmp_path_factory.mktemp("saved")
    asked = load_study(None, {"horizon": 3, "inverter": False, "angle_orders": ()})
    identify([asked.load(run)], study=asked.study).save(folder)
    return folder


@pytest.fixture
def trained(saved, monkeypatch):
    """Replace the training: return a function that says with which verdict it ends."""

    def ends(verdict="fixed", stopped=False):
        fit = Fit.load(saved)
        fit = replace(fit, horizon=replace(fit.horizon, verdict=verdict))

        def train(*_, **__):
            if stopped:
                raise Stopped(fit)
            return fit

        monkeypatch.setattr(command_line, "identify", train)

    return ends


def failing(*_args, **_kwargs):
    raise ZeroDivisionError("float division by zero")


def interrupted(*_args, **_kwargs):
    raise KeyboardInterrupt


def files(folder):
    """Return the files of a result in a folder, which may have a log of the training beside."""
    made = {p.relative_to(folder).as_posix() for p in folder.rglob("*.*") if p.is_file()}
    return made - {"events.jsonl", ".lock"}


def page_of(folder):
    return (folder / "report.html").read_text()


BROKEN = {
    "a section": ("penode.report.sections.ladder_table", "The section on horizons"),
    "a picture": ("penode.report.sections.parameter_over_ladder", "The picture "),
    "the machine's own picture": (
        "penode.pmsm.report.flux_sections.flux_map_surfaces",
        "The picture \N{LEFT DOUBLE QUOTATION MARK}The same map in perspective",
    ),
    "the verdict's box": ("penode.report.fit_report.verdict_notice", "The verdict"),
}


@pytest.mark.parametrize(
    ("part", "verdict", "status", "stopped"),
    [
        ("a section", "fixed", 0, False),
        pytest.param("a section", "implausible", 1, False, marks=pytest.mark.slow),
        ("a section", "stopped", 130, True),
        pytest.param("a picture", "fixed", 0, False, marks=pytest.mark.slow),
        ("the machine's own picture", "implausible", 1, False),
        ("the verdict's box", "implausible", 1, False),
    ],
)
def test_what_fails_is_left_out_by_name_and_the_status_is_the_verdicts(
    identified, trained, monkeypatch, details, part, verdict, status, stopped
):
    target, subject = BROKEN[part]
    monkeypatch.setattr(target, failing)
    trained(verdict, stopped)
    done = identified()
    assert done.returncode == status, done.stderr
    assert files(identified.out) == WHOLE | {"report.html"}
    assert json.loads((identified.out / "result.json").read_text())["horizon"]["verdict"] == verdict
    said = done.stderr.splitlines()[0]
    assert said.startswith(f"note: {subject}")
    assert "could not be made (ZeroDivisionError: float division by zero); please send" in said
    page = page_of(identified.out)
    assert said.removeprefix("note: ") in page
    assert page.count("<h2 ") >= 7
    (written,) = details.iterdir()
    assert str(written) in said
    assert "penode identify" in written.read_text()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ZeroDivisionError("no"), "note: The report could not be made (ZeroDivisionError: no); p"),
        (OSError(28, "No space left on device", "x/report.html"), "note: The report was not writ"),
        (MemoryError(), "note: The report could not be made (MemoryError); please send in "),
    ],
)
def test_a_report_that_cannot_be_made_at_all_leaves_the_answer(
    identified, trained, monkeypatch, error, said
):
    def broken(*_):
        raise error

    identified.out.mkdir()
    (identified.out / "report.html").write_text("of an earlier result")
    monkeypatch.setattr("penode.pmsm.report.machine_report.machine_report", broken)
    trained("implausible")
    done = identified()
    assert done.returncode == 1
    assert done.stderr.startswith(said)
    assert done.stderr.count("\n") == 1
    assert files(identified.out) == WHOLE, "the report of an earlier result does not stay beside it"
    assert "report.html" not in done.stdout


def test_ctrl_c_during_the_report_leaves_the_answer_and_report_makes_the_page(
    identified, trained, monkeypatch, penode
):
    trained()
    with monkeypatch.context() as patched:
        patched.setattr("penode.pmsm.report.machine_report.machine_report", interrupted)
        done = identified()
    assert done.returncode == 130
    assert done.stderr == (
        "Stopped; the result is written, its report is not: "
        f"penode report {identified.out} makes it.\n"
    )
    assert files(identified.out) == WHOLE
    assert re.search(r"^R +\d", done.stdout, re.MULTILINE), "the answer was printed before"
    assert penode("report", identified.out).returncode == 0
    assert "Provenance" in page_of(identified.out)


def test_json_is_all_that_is_printed(identified, trained):
    trained()
    done = identified("--json")
    assert json.loads(done.stdout) == json.loads((identified.out / "result.json").read_text())
    assert (done.returncode, done.stderr) == (0, "")
    assert (identified.out / "report.html").exists()


KILLED = """
import os, signal, sys
from penode import Fit
from penode.pmsm import result_files
from penode.pmsm.report import machine_report as page
page.machine_report = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
result_files.write(Fit.load(sys.argv[1]), sys.argv[2])
"""


def test_a_process_killed_before_its_report_leaves_a_folder_that_is_whole(saved, penode, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("of an earlier result")
    done = subprocess.run([sys.executable, "-c", KILLED, saved, out], timeout=120, check=False)
    assert done.returncode == -signal.SIGKILL
    assert files(out) == WHOLE
    assert penode("report", out).returncode == 0
    assert "<h2 " in page_of(out)


def test_report_of_a_saved_fit_leaves_out_by_name_too(saved, penode, monkeypatch, tmp_path):
    Fit.load(saved).save(tmp_path / "out")
    monkeypatch.setattr("penode.report.sections.ladder_table", failing)
    done = penode("report", tmp_path / "out")
    assert done.returncode == 0
    assert done.stderr.startswith("note: The section on horizons could not be made (ZeroDivision")
    assert "The section on horizons could not be made" in page_of(tmp_path / "out")


def test_a_saved_fit_has_the_page_that_the_identification_made(identified, penode):
    assert identified().returncode == 0
    made = page_of(identified.out)
    assert penode("report", identified.out).returncode == 0
    assert page_of(identified.out) == made


def test_a_check_that_fails_is_a_warning_and_the_verdict_stands(identified, monkeypatch):
    monkeypatch.setattr(objections, "finite_residual", failing)
    done = identified()
    assert done.returncode == 0, done.stderr
    said = without_progress(done.stderr).splitlines()
    assert [line.split(" could ")[0] for line in said] == [
        "note: The check for few samples decide",
        "note: The check for dependent residual",
    ]
    warnings = json.loads((identified.out / "result.json").read_text())["warnings"]
    assert [line.removeprefix("note: ") for line in said] == warnings[:2]
    assert page_of(identified.out).count("The check for ") == 2


def test_a_failure_of_the_training_is_a_failure_of_the_command(identified, monkeypatch):
    monkeypatch.setattr(sys.modules["penode.horizon.search"], "choose", failing)
    done = identified()
    assert done.returncode == 70
    assert not (identified.out / "result.json").exists()
    assert Path(re.search(r"send in (\S+),", done.stderr)[1]).exists()
