"""Ctrl-C and --resume, as a person uses them."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.cli.conftest import without_progress

import penode as library
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli import identify as command_line
from penode.data.save import save
from penode.fit.archive import write_atomically
from penode.pmsm import study, study_settings

LADDER = [1, 5, 18, 40]  # of --horizon 40


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return two short recordings."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, speed in (("run.csv", 1500.0), ("other.csv", 1400.0)):
        run = simulate(TRACTION_300A, Lissajous(240.0, 50.0, 54.0), speed_rpm=speed, duration=0.4)
        save(run, folder / name)
    return folder / "run.csv", folder / "other.csv"


@dataclass
class Ended:
    """A process that ended, and its folder."""

    status: int
    printed: str
    said: str
    out: Path


def interrupted(run, out, mark):
    """Run ``identify`` in a process of its own and press Ctrl-C when the log has the mark."""
    program = Path(sys.executable).with_name("penode")
    process = subprocess.Popen(
        [program, "identify", run, "--horizon", "40", "--out", out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    log, limit = out / "events.jsonl", time.monotonic() + 300
    while process.poll() is None and time.monotonic() < limit:
        if log.exists() and mark in log.read_text():
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    printed, said = process.communicate(timeout=300)
    return Ended(process.returncode, printed, said, out)


@pytest.fixture(scope="module")
def stopped(runs, tmp_path_factory):
    return interrupted(runs[0], tmp_path_factory.mktemp("stopped") / "out", '"event": "rung"')


@pytest.fixture
def folder(stopped, tmp_path):
    """Return a copy of what the stopped process left."""
    copy = tmp_path / "out"
    for path in (p for p in stopped.out.rglob("*") if p.is_file()):
        target = copy / path.relative_to(stopped.out)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(path.read_bytes())
    return copy


def files(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*.*")}


def told(folder, kind):
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    return [event.get("horizon") for event in events if event["event"] == kind]


WHOLE = {
    "events.jsonl",
    "fit/fit.json",
    "fit/fit.npz",
    "flux_map.csv",
    "report.html",
    "result.json",
}


# --- one real Ctrl-C --------------------------------------------------------------------------


def test_ctrl_c_leaves_the_best_so_far_as_a_whole_result(stopped):
    assert stopped.status == 130
    assert (
        without_progress(stopped.said)
        == "Stopped; this is the best so far. Add --resume to go on.\n"
    )
    assert "stopped" in stopped.printed
    assert set(files(stopped.out)) == WHOLE | {"fit/checkpoint.json"}
    horizon = json.loads((stopped.out / "result.json").read_text())["horizon"]
    reached = [rung["horizon"] for rung in horizon["ladder"]]
    assert reached == LADDER[: len(reached)]
    assert 1 <= len(reached) < len(LADDER)
    assert horizon["verdict"] == "stopped"
    assert horizon["reason"] == "The horizon asked for, 40, was not reached."
    assert told(stopped.out, "stop") == [reached[-1]]
    fit = library.Fit.load(stopped.out)
    assert fit.parameters["R"].value == pytest.approx(TRACTION_300A.resistance, rel=0.5)
    assert fit.flux_map(0.0, 0.0)[0] == pytest.approx(0.0577, rel=0.1)


@pytest.mark.slow
def test_the_same_command_with_resume_climbs_to_the_end(runs, folder, penode, monkeypatch):
    """That it ends as an unbroken climb does is shown bit by bit in tests/horizon."""

    def computed_anew(*_):
        raise AssertionError("What the stopped fit began with is in its checkpoint.")

    for name in ("_start", "judge", "calibration_of"):
        monkeypatch.setattr(study, name, computed_anew)
    monkeypatch.setattr(study_settings, "structure_of", computed_anew)
    stopped = json.loads((folder / "result.json").read_text())["horizon"]["ladder"]
    begun = told(folder, "rung")
    done = penode("identify", runs[0], "--horizon", 40, "--out", folder, "--resume")
    assert (done.returncode, without_progress(done.stderr)) == (0, "")
    assert set(files(folder)) == WHOLE, "a finished fit leaves no checkpoint"
    horizon = json.loads((folder / "result.json").read_text())["horizon"]
    assert (horizon["selected"], horizon["verdict"]) == (40, "fixed")
    for taken, kept in zip(horizon["ladder"], stopped, strict=False):
        assert taken["parameters"] == kept["parameters"], "to the last digit"
        assert (taken["iterations"], taken["outcome"]) == (kept["iterations"], kept["outcome"])
    assert told(folder, "rung") == LADDER, "each rung is told once"
    assert told(folder, "resume") == [None]
    after = (folder / "events.jsonl").read_text().partition('"resume"')[2]
    assert all(f'"evaluation", "horizon": {horizon},' not in after for horizon in begun)


# --- resuming what cannot be ------------------------------------------------------------------


def test_other_recordings_and_other_options_are_refused_and_nothing_changes(runs, folder, penode):
    before = files(folder)
    cases = {
        "recordings": (runs[1], "--horizon", 40),
        "horizon": (runs[0], "--horizon", 41),
        "purpose ('parameters' there, 'simulation' here)": (
            *(runs[0], "--horizon", 40, "--purpose", "simulation"),
        ),
        "seed": (runs[0], "--horizon", 40, "--seed", 1),
        "flux map": (runs[0], "--horizon", 40, "--flux-map", "mlp"),
        "hold": (runs[0], "--horizon", 40, "--hold", "stationary"),
    }
    for what, arguments in cases.items():
        done = penode("identify", *arguments, "--out", folder, "--resume")
        assert done.returncode == 2, what
        assert done.stderr.count("\n") == 1
        assert f"checkpoint.json: the stopped fit differs in its {what}" in done.stderr
        assert files(folder) == before, what


def test_a_damaged_checkpoint_is_refused_in_one_sentence(runs, folder, penode):
    (folder / "fit" / "checkpoint.json").write_text('{"schema"')
    before = files(folder)
    done = penode("identify", runs[0], "--horizon", 40, "--out", folder, "--resume")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert str(folder / "fit" / "checkpoint.json") in done.stderr
    assert files(folder) == before


# --- leaving at once --------------------------------------------------------------------------


@pytest.fixture
def scripted(monkeypatch):
    """Replace the training by a script: events to tell, then what to raise."""

    def replace_by(events, error):
        def identify(recordings, *, observer, checkpoint, **rest):
            for event in events:
                if event["event"] == "rung":
                    write_atomically(checkpoint.path, "a finished rung")
                observer(event)
            raise error

        monkeypatch.setattr(command_line, "identify", identify)

    return replace_by


RUNG = {
    "event": "rung",
    "horizon": 1,
    "stage": 1,
    "stages": 4,
    "rmse": 1.0,
    "parameters": {},
    "units": {},
    "evaluations": 3,
}


def test_ctrl_c_before_the_first_rung_leaves_what_was_there(runs, folder, penode, scripted):
    before = files(folder)
    scripted([{"event": "start"}], KeyboardInterrupt())
    done = penode("identify", runs[0], "--out", folder, "--overwrite")
    assert (done.returncode, done.stderr) == (130, "Stopped; no result was written.\n")
    assert files(folder) == before


def test_a_second_ctrl_c_leaves_the_result_of_before_whole(runs, folder, penode, scripted):
    before = files(folder)
    scripted([{"event": "start"}, RUNG], KeyboardInterrupt())  # not caught: no best was made
    done = penode("identify", runs[0], "--out", folder, "--overwrite")
    assert done.returncode == 130
    assert done.stderr == (
        "rung 1 of 4: H = 1, RMSE over H steps 1.000\n"
        "Stopped; the finished horizons are kept: add --resume to go on.\n"
    )
    assert told(folder, "rung") == [1]
    after = files(folder)
    for name in WHOLE - {"events.jsonl"}:
        assert after[name] == before[name], name


def test_resume_without_a_checkpoint_says_so_and_begins_anew(runs, folder, penode, scripted):
    (folder / "fit" / "checkpoint.json").unlink()
    scripted([{"event": "start"}, RUNG], KeyboardInterrupt())
    refused = penode("identify", runs[0], "--out", folder, "--resume")
    assert refused.stderr == (
        f"error: {folder} has a finished result: add --overwrite to replace it, or give another "
        "--out.\n"
    )
    done = penode("identify", runs[0], "--out", folder, "--resume", "--overwrite")
    assert "checkpoint.json is missing, so nothing is resumed; beginning anew." in done.stderr
    assert told(folder, "start") == [None], "the log of before is replaced"


def test_a_result_is_not_replaced_unasked(runs, folder, penode, scripted):
    before = files(folder)
    scripted([{"event": "start"}], KeyboardInterrupt())
    done = penode("identify", runs[0], "--out", folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"error: {folder} has a fit that was stopped: add --resume to go on with it, add "
        "--overwrite to replace it, or give another --out.\n"
    )
    assert files(folder) == before
