"""The command line: what it prints, writes and returns."""

import gc
import json
import re
import signal
import subprocess
import sys
import time
import weakref
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import penode as library

WHOLE = pytest.mark.parametrize("demo", ["whole"], indirect=True)


def test_demo_prints_the_answer_beside_the_truth(demo):
    folder, printed = demo
    text = " ".join(printed.split())
    doubt = "no answer; must not be used: "  # of two horizons
    assert re.search(rf"R\s+({doubt})?(1\d|9)\.\d+ mΩ, 95 % interval", text)
    assert (doubt in text) == ("no plateau" in text)
    assert "R = 10.00 mΩ: error" in text
    assert "inside the interval" in text
    assert re.search(r"horizon\s+\d+ steps", text)
    assert (folder / "report.html").name in printed.replace("\n", "")


def test_demo_figures_are_those_of_the_result(demo):
    folder, printed = demo
    result = json.loads((folder / "result.json").read_text())
    estimate = result["parameters"]["R"]
    assert abs(estimate["value"] / 0.01 - 1) < 0.03
    assert f"error {100 * (estimate['value'] / 0.01 - 1):+.2f} %" in " ".join(printed.split())
    errors = [m["free_run_rmse_A"] for m in result["metrics"]["validation"].values()]
    assert len(errors) == 2
    assert max(errors) < 5


def test_demo_leaves_every_file(demo):
    folder, _ = demo
    names = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    assert names == {
        "events.jsonl",
        "fit/fit.json",
        "fit/fit.npz",
        "flux_map.csv",
        "recordings/test_2500rpm.csv",
        "recordings/test_900rpm.csv",
        "recordings/train_1500rpm.csv",
        "report.html",
        "result.json",
    }
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    rungs = [event["horizon"] for event in events if event["event"] == "rung"]
    ladder = json.loads((folder / "result.json").read_text())["horizon"]["ladder"]
    assert rungs == [rung["horizon"] for rung in ladder]


@pytest.mark.slow
def test_identify_fixed_horizon_and_parquet(demo, penode, tmp_path):
    recordings = demo[0] / "recordings"
    parquet = tmp_path / "run.parquet"
    pl.read_csv(recordings / "train_1500rpm.csv").write_parquet(parquet)
    out = tmp_path / "out"
    validation = recordings / "test_900rpm.csv"
    plain = ("--no-inverter", "--angle-orders", "none", "--horizon", 2)
    done = penode("identify", parquet, "--validate", validation, *plain, "--out", out)
    assert done.returncode == 0, done.stderr
    assert done.stderr == "", "piped output is quiet"
    result = json.loads((out / "result.json").read_text())
    assert result["horizon"]["selected"] == 2
    assert set(result["metrics"]["validation"]) == {"test_900rpm.csv"}
    assert result["provenance"]["command"].startswith("penode identify")


@pytest.mark.slow
@WHOLE
def test_unanswerable_question_exits_with_1_and_says_why(demo, penode, tmp_path):
    run = demo[0] / "recordings" / "train_1500rpm.csv"
    plain = ("--no-inverter", "--angle-orders", "none", "--horizon", 1)
    done = penode("identify", run, "--flux-map", "mlp", *plain, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "not identifiable" in done.stdout
    assert "cannot distinguish R" in " ".join(done.stdout.split())
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["horizon"]["verdict"] == "not identifiable"


def test_report_is_written_again_from_the_saved_fit(demo, penode):
    page = demo[0] / "report.html"
    before = page.read_text()
    page.unlink()
    done = penode("report", demo[0])
    assert done.returncode == 0, done.stderr
    again = page.read_text()
    # The demo alone knows the truth, and has a section more.
    assert "The machine as it is" in before
    assert "The machine as it is" not in again
    answer = slice(again.index("<h2"), again.index("Flux-linkage map"))
    assert again[answer] in before


def test_saved_demo_loads_in_python(demo):
    fit = library.Fit.load(demo[0])
    psi_d, psi_q = fit.flux_map(0.0, 0.0)
    assert psi_d == pytest.approx(0.0577, rel=0.03)
    assert abs(psi_q) < 1e-3


DRIVE = """
machine = {machine}
duration = 0.4
speed_rpm = 1500.0
reference = {{ kind = "lissajous", amplitude = 240.0, rate_d = 14.0, rate_q = 15.0 }}
"""


def deviations(penode, demo, tmp_path, machine) -> list[float]:
    """Return the rms differences of i_d, i_q, u_d, u_q to the demo's recording, as printed."""
    (tmp_path / "drive.toml").write_text(DRIVE.format(machine=machine))
    against = demo[0] / "recordings" / "train_1500rpm.csv"
    out = tmp_path / "drive.csv"
    done = penode("simulate", tmp_path / "drive.toml", "--out", out, "--against", against)
    assert done.returncode == 0, done.stderr
    return [float(x) for x in re.findall(r"[iu]_[dq] ([\d.]+) [AV]", done.stdout)]


@pytest.mark.slow
@WHOLE
def test_the_identified_machine_drives_like_the_true_one(demo, penode, tmp_path):
    """On the recording's own reference: 240 A and 100 V, the ripple of the slots is the rest."""
    sheet = "pole_pairs = 5, inductance_d = 180e-6, inductance_q = 450e-6"
    found = f'{{ result = "{demo[0]}", {sheet} }}'
    identified = deviations(penode, demo, tmp_path, found)
    assert max(identified[:2]) < 3.5
    assert max(identified[2:]) < 1.5
    other = deviations(penode, demo, tmp_path, '"comsol_300A"')
    assert max(other[2:]) > 10 * max(identified[2:])


def table(rows: int = 400, **changes) -> dict[str, np.ndarray]:
    time = np.arange(rows) * 1e-4
    columns = {
        "t": time,
        "u_d": 5 * np.sin(30 * time),
        "u_q": 30 + np.cos(20 * time),
        "i_d": 100 * np.sin(50 * time),
        "i_q": 80 * np.cos(40 * time),
        "omega_el": np.full(rows, 500.0),
    }
    return {name: value for name, value in {**columns, **changes}.items() if value is not None}


def broken(name: str, row: int, value: object) -> np.ndarray:
    values = table()[name].copy()
    values[row] = value
    return values


JITTER = table()["t"] + 2e-5 * np.random.default_rng(0).standard_normal(400)
UNUSABLE = {
    "missing column": (table(u_q=None), ["u_q"]),
    "NaN": (table(i_d=broken("i_d", 7, np.nan)), ["i_d", "row 8"]),
    "time in ms": (table(t=table()["t"] * 1e3), ["time step of 0.1 s", "t in s"]),
    "gaps": (table(t=table()["t"] + 5e-3 * (np.arange(400) // 150)), ["rows 150 and 151"]),
    "jitter": (table(t=JITTER), ["t"]),
    "three samples": (table(rows=3), ["3"]),
    "too few for a machine": (table(rows=150), ["150", "200"]),
    "constant currents": (table(i_d=np.ones(400), i_q=np.zeros(400)), ["i_d"]),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_recording_gets_one_sentence_and_leaves_nothing(case, penode, tmp_path):
    columns, words = UNUSABLE[case]
    run = tmp_path / "run.csv"
    pl.DataFrame(columns).write_csv(run)
    assert_refused(
        penode("identify", run, "--out", tmp_path / "out"), tmp_path, ["run.csv", *words]
    )


def test_a_refusal_is_one_line_of_the_process_too(penode_process, tmp_path):
    assert_refused(penode_process("identify", "gone.csv", "--out", tmp_path / "out"), tmp_path, [])


def test_empty_file_and_text_named_parquet_are_refused(penode, tmp_path):
    for name in ("empty.csv", "text.parquet"):
        run = tmp_path / name
        run.write_text("" if name == "empty.csv" else "t,u_d\n0,1\n")
        assert_refused(penode("identify", run, "--out", tmp_path / "out"), tmp_path, [name])


def test_unknown_flux_map_and_horizon_are_refused(penode, tmp_path):
    run = tmp_path / "run.csv"
    pl.DataFrame(table()).write_csv(run)
    for option, value in (("--flux-map", "magic"), ("--horizon", "many"), ("--horizon", "0")):
        done = penode("identify", run, option, value, "--out", tmp_path / "out")
        assert_refused(done, tmp_path, [value])


def test_wrong_usage_exits_with_2(penode):
    assert penode("identify").returncode == 2
    assert penode("polish").returncode == 2
    assert penode("report", "/nowhere").returncode == 2


def test_interrupt_leaves_nothing_and_exits_with_130(demo, tmp_path):
    run = demo[0] / "recordings" / "train_1500rpm.csv"
    program, plain = (
        Path(sys.executable).with_name("penode"),
        # A network's first horizon takes seconds, beside which a look every hundredth is soon.
        ("--no-inverter", "--angle-orders", "none", "--flux-map", "mlp"),
    )
    command = [program, "identify", run, *plain, "--out", tmp_path / "out"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    log = tmp_path / "out" / "events.jsonl"
    for _ in range(30000):
        if log.exists() and "evaluation" in log.read_text():
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=300)
    assert process.returncode == 130
    assert said == "Stopped; no result was written.\n"
    assert not (tmp_path / "out").exists()


def assert_refused(done, folder: Path, words: list[str]) -> None:
    assert done.returncode == 2
    assert done.stdout == ""
    sentence = done.stderr.strip()
    assert sentence.count("\n") == 0, sentence
    for word in words:
        assert word in sentence
    assert not (folder / "out").exists()


class _Cycle:
    """Garbage that reference counting does not free."""

    def __init__(self):
        self.own = self


def test_what_a_run_leaves_behind_is_freed_by_the_next(penode):
    penode("report", "nowhere")
    gc.disable()  # so that nothing but the run itself looks for garbage
    try:
        left = weakref.ref(_Cycle())
        assert left() is not None
        penode("report", "nowhere")
    finally:
        gc.enable()
    assert left() is None
