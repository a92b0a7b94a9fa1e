"""The command ``penode sweep`` as a person uses it."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from distributed import LocalCluster
from validate.command import run

from penode import Fit
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli.sweep_workers import _outcomes
from penode.data.save import save
from penode.fit.result_folder import claimed
from penode.pmsm.sweep.table import LINES, PARQUET, TIMES
from penode.pmsm.sweep.task import Outcome

STUDY = """
inverter = false
angle_orders = []

[sweep]
recordings = ["run*.csv", "missing.csv"]
name = "(?P<machine>run.)"
horizons = [1, 2]
"""


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """Return a study file beside two recordings."""
    folder = tmp_path_factory.mktemp("fleet")
    for name, rate in (("runA", 140.0), ("runB", 135.0)):
        reference = Lissajous(200.0, rate, 150.0)
        recorded = simulate(TRACTION_300A, reference, speed_rpm=150.0, duration=0.2)
        save(recorded, folder / f"{name}.csv")
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def recording(fleet):
    return fleet.parent / "runA.csv"


@pytest.fixture(scope="module", params=[1, pytest.param(2, marks=pytest.mark.slow)])
def whole(request, fleet, tmp_path_factory):
    """Return how a sweep of the fleet by one or two processes beside this one ended."""
    out = tmp_path_factory.mktemp("sweep") / "out"
    ended = run("sweep", "--config", fleet, "--out", out, "--jobs", request.param)
    return ended, out


def untimed(out):
    return pl.read_parquet(out / PARQUET).drop(TIMES)


def test_a_line_a_row_and_every_fit(whole):
    done, out = whole
    assert done.status == 0, done.printed
    assert "runA.csv, H = 2, seed 0: R 9." in done.printed
    assert "missing.csv: the file cannot be read" in done.printed
    table = untimed(out)
    assert table["horizon"].to_list() == [1, 2] * 3
    assert table["machine"].to_list() == ["runA", "runA", "runB", "runB", None, None]
    assert table["status"].to_list() == ["done"] * 4 + ["failed"] * 2
    assert table["R"].head(4).to_list() == pytest.approx([0.01] * 4, rel=0.05)
    assert (table["R_low"] < table["R"]).sum() == 4
    fit = Fit.load(out / "fits" / table["key"][1])
    assert fit.parameters["R"].value == table["R"][1]
    flux, inductance = fit.flux_map(0.0, 0.0), fit.differential_inductance(0.0, 0.0)
    assert (table["psi_d"][1], table["psi_q"][1]) == tuple(flux)
    assert (table["l_dd"][1], table["l_qq"][1]) == (inductance[0, 0], inductance[1, 1])
    assert table["psi_d_std"][1] == fit.learned_deviation(np.zeros((1, 2)))[0, 0]
    assert "2 of 3 recordings answered" in (out / "report.html").read_text()
    rows = [line.split() for line in done.printed.splitlines()]
    rows = [(row[:2], row[-3:]) for row in rows]
    assert (["1", "3"], ["2", "0", "1"]) in rows
    assert (["2", "3"], ["2", "0", "1"]) in rows


@pytest.mark.slow
def test_a_cluster_makes_the_same_table_and_does_nothing_twice(whole, fleet, penode, tmp_path):
    """To the last bit, of one process where the other table is of two."""
    with LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster:
        asked = ("sweep", "--config", fleet, "--out", tmp_path)
        done = penode(*asked, "--dask", cluster.scheduler_address)
    assert done.returncode == 0, done.stderr
    assert untimed(tmp_path).equals(untimed(whole[1]))
    before = (tmp_path / LINES).read_text().splitlines()
    fewer = fleet.with_name("fewer.toml")
    fewer.write_text(STUDY.replace(', "missing.csv"', ""))
    assert penode("sweep", "--config", fewer, "--out", tmp_path).returncode == 0
    assert (tmp_path / LINES).read_text().splitlines() == before
    assert len(untimed(tmp_path)) == 4


def test_report_writes_the_page_anew(whole, penode):
    _, out = whole
    page = (out / "report.html").read_bytes()
    (out / "report.html").unlink()
    assert penode("report", out).returncode == 0
    assert (out / "report.html").read_bytes() == page


@pytest.mark.slow
def test_ctrl_c_stops_at_once_and_keeps_what_is_finished(recording, tmp_path):
    program = Path(sys.executable).with_name("penode")
    asked = ("--horizons", "1,4,5,6,7,8", "--jobs", "1", "--out", tmp_path)
    process = subprocess.Popen(
        [program, "sweep", recording, "--no-inverter", "--angle-orders", "none", *asked],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    kept, limit = tmp_path / LINES, time.monotonic() + 200
    while process.poll() is None and time.monotonic() < limit:
        if kept.exists() and kept.stat().st_size:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    pressed = time.monotonic()
    printed, said = process.communicate(timeout=60)
    assert time.monotonic() - pressed < 5
    assert process.returncode == 130
    assert printed == ""
    last = "Stopped; what is finished is kept, and the same command goes on."
    assert said.splitlines()[-1] == last
    assert kept.read_bytes().endswith(b"\n")
    assert not (tmp_path / PARQUET).exists()
    with claimed(tmp_path):
        pass


PARENT = """
import os, time
from penode.cli import sweep_workers
if __name__ == "__main__":
    with sweep_workers.processes(1) as workers:
        executor = workers.args[0][0]()
        print(executor.submit(os.getpid).result(), flush=True)
        time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="No list of processes.")
def test_ctrl_c_while_workers_start_is_one_sentence(recording, tmp_path):
    """As a terminal sends it: to the processes that import as well."""
    program = Path(sys.executable).with_name("penode")
    process = subprocess.Popen(
        [
            program,
            "sweep",
            recording,
            "--jobs",
            "2",
            "--horizons",
            "1,2",
            "--out",
            tmp_path / "out",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    limit = time.monotonic() + 100
    while len(children.read_text().split()) < 3 and time.monotonic() < limit:
        time.sleep(0.01)
    time.sleep(0.3)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said == "Stopped; what is finished is kept, and the same command goes on.\n"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="No list of processes.")
def test_the_workers_of_a_killed_sweep_end(tmp_path):
    program = tmp_path / "parent.py"
    program.write_text(PARENT)
    with subprocess.Popen([sys.executable, program], stdout=subprocess.PIPE, text=True) as parent:
        worker = int(parent.stdout.readline())
        assert Path(f"/proc/{worker}").exists()
        parent.kill()
    limit = time.monotonic() + 5
    while Path(f"/proc/{worker}").exists() and time.monotonic() < limit:
        time.sleep(0.02)
    assert not Path(f"/proc/{worker}").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--seeds", "1000000000000"), "sweep.seeds must be a whole number >= 1 and <= 10000"),
        (("--horizons", "1,a"), "--horizons must be whole numbers with commas"),
        (("--horizons", "0"), "sweep.horizons[0] must be a whole number >= 1"),
        (("--seeds", "0"), "<= 10000, got 0"),
        (("--jobs", "0"), "--jobs must be >= 1, got 0"),
        (("--dask", "nonsense"), "--dask nonsense: no scheduler answers"),
    ],
)
def test_bad_options_are_one_sentence_and_write_nothing(
    recording, penode, tmp_path, options, words
):
    done = penode("sweep", recording, *options, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


class Lossy(Executor):
    """Does tasks at once, but the first of some names are lost with the worker."""

    def __init__(self, losses):
        self.losses = losses

    def submit(self, function, /, task):
        future = Future()
        if self.losses.get(task.key, 0):
            self.losses[task.key] -= 1
            future.set_exception(BrokenProcessPool())
        else:
            future.set_result(Outcome({"status": "done"}))
        return future


def test_the_task_of_a_lost_worker_is_done_again_by_another():
    made, losses = [], {"b": 2, "c": 3}

    def renew():
        made.append(Lossy(losses))
        return made[-1]

    tasks = [SimpleNamespace(key=key) for key in "abcd"]
    outcomes = {t.key: o.values for t, o in _outcomes([renew] * 2, BrokenProcessPool, iter(tasks))}
    assert {key: values["status"] for key, values in outcomes.items()} == {
        "a": "done",
        "b": "done",
        "c": "failed",
        "d": "done",
    }
    assert "ended its worker 3 times" in outcomes["c"]["error"]
    assert len(made) == 2 + 5


@pytest.mark.slow
def test_killed_workers_of_a_cluster_change_nothing(whole, fleet, tmp_path):
    """One of its workers is killed again and again; their nannies start others."""
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        program = Path(sys.executable).with_name("penode")
        asked = ("--config", fleet, "--out", tmp_path, "--dask", cluster.scheduler_address)
        killed = 0
        with subprocess.Popen([program, "sweep", *asked]) as process:
            while killed < 2 and process.poll() is None:
                time.sleep(6)
                next(iter(cluster.workers.values())).process.process.kill()
                killed += 1
        assert process.returncode == 0
    assert killed
    assert untimed(tmp_path).equals(untimed(whole[1]))
