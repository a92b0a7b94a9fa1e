"""The command ``penode sweep`` as a person uses it."""

import csv
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from distributed import LocalCluster

from penode.data.save import save
from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import simulate
from penode.pmsm.sweep import Swept

PLAIN = ("--no-inverter", "--angle-orders", "none")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.csv"
    reference = Lissajous(200.0, 140.0, 150.0)
    save(simulate(TRACTION_300A, reference, speed_rpm=150.0, duration=0.2), path)
    return path


def test_a_table_a_figure_and_every_fit(recording, penode, tmp_path):
    asked = ("sweep", recording, *PLAIN, "--horizons", "1,4", "--seeds", 1, "--out", tmp_path)
    done = penode(*asked, "--jobs", 2)
    assert done.returncode == 0, done.stderr
    assert "seed 0, H = 4: R 9.8" in done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()] == [
        "H",
        "1",
        "4",
        "table",
        "figure",
    ]
    rows = list(csv.DictReader((tmp_path / "sweep.csv").open()))
    assert [(row["horizon"], row["seed"]) for row in rows] == [("1", "0"), ("4", "0")]
    assert all(float(row["R"]) == pytest.approx(0.01, rel=0.03) for row in rows)
    assert (tmp_path / "sweep.png").exists()
    before = (tmp_path / "seed0" / "H4" / "swept.json").stat().st_mtime_ns
    assert penode(*asked, "--resume").returncode == 0
    assert (tmp_path / "seed0" / "H4" / "swept.json").stat().st_mtime_ns == before


def test_on_a_cluster(recording, penode, tmp_path):
    with LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster:
        asked = ("sweep", recording, *PLAIN, "--horizons", "1", "--seeds", 1, "--out", tmp_path)
        done = penode(*asked, "--dask", cluster.scheduler_address)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "seed0" / "H1" / "fit" / "fit.npz").exists()


def test_ctrl_c_stops_at_once_and_keeps_what_is_finished(recording, tmp_path):
    program = Path(sys.executable).with_name("penode")
    asked = ("--horizons", "1,4,5,6,7,8", "--seeds", "1", "--jobs", "1", "--out", tmp_path)
    process = subprocess.Popen(
        [program, "sweep", recording, *PLAIN, *asked],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    kept, limit = tmp_path / "seed0" / "H1" / "swept.json", time.monotonic() + 200
    while process.poll() is None and not kept.exists() and time.monotonic() < limit:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    pressed = time.monotonic()
    printed, said = process.communicate(timeout=60)
    assert time.monotonic() - pressed < 5
    assert process.returncode == 130
    assert printed == ""
    assert said.splitlines()[-1] == "Stopped; finished fits are kept. Add --resume to go on."
    assert kept.exists()
    assert not (tmp_path / "sweep.csv").exists()


PARENT = """
import os, time
from penode.cli.sweep import _workers
if __name__ == "__main__":
    with _workers(1, None) as executor:
        print(executor.submit(os.getpid).result(), flush=True)
        time.sleep(60)
"""


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
        (("--horizons", "1,1000000000"), "horizon 1000000000 with 1 past samples"),
        (("--seeds", "1000000000000"), "1000000000000 seeds came"),
        (("--horizons", "1,a"), "--horizons 1,a came"),
        (("--horizons", "0"), "horizons [0] came"),
        (("--seeds", "0"), "0 seeds came"),
        (("--jobs", "0"), "--jobs 0 came"),
        (("--dask", "nonsense"), "--dask nonsense: no scheduler answers"),
    ],
)
def test_bad_options_are_one_sentence_and_write_nothing(
    recording, penode, tmp_path, options, words
):
    done = penode("sweep", recording, *PLAIN, *options, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def swept(horizon, seed, resistance, free_run, failure=""):
    parameters = {} if failure else {"R": resistance}
    units = {} if failure else {"R": "ohm"}
    return Swept(horizon, seed, parameters, {}, units, 0.1, free_run, 12.4, failure)


@pytest.fixture
def made(penode, tmp_path, monkeypatch):
    """Return a function that prints a sweep whose identifications are given."""
    run_file = tmp_path / "run.csv"
    rows = (",".join([f"{k / 1e3}", *["1"] * 5]) for k in range(9))
    run_file.write_text("\n".join(["t,u_d,u_q,i_d,i_q,omega_el", *rows]) + "\n")

    def run(*ones, horizons="1,4"):
        written = []
        monkeypatch.setattr("penode.cli.sweep.sweep", lambda *_: iter(ones))
        monkeypatch.setattr("penode.cli.sweep.write_sweep", lambda all_, _: written.extend(all_))
        done = penode("sweep", run_file, "--horizons", horizons, "--seeds", 3, "--out", tmp_path)
        return done, written

    return run


def test_a_row_is_the_mean_over_seeds_and_what_they_differ_by(made):
    """Half the range beside the mean, and the median of the free runs; seeds end in any order."""
    ones = [swept(4, 0, 9e-3, 3.0), swept(1, 1, 10.4e-3, 1.0), swept(4, 1, 11e-3, float("inf"))]
    done, written = made(*ones, swept(1, 0, 10e-3, 2.0), swept(1, 2, 10.4e-3, 9.0))
    assert done.returncode == 0
    assert [(one.horizon, one.seed) for one in written] == [(1, 0), (1, 1), (1, 2), (4, 0), (4, 1)]
    assert [line.split() for line in done.stdout.splitlines()[:3]] == [
        ["H", "R", "free", "run"],
        ["1", "10.27", "±", "0.20", "mΩ", "2.00", "A"],
        ["4", "10.00", "±", "1.0", "mΩ", "diverges"],
    ]
    assert done.stderr.splitlines()[0] == "seed 0, H = 4: R 9.000 mΩ, 12 s"


def test_failures_are_counted_and_only_all_of_them_are_an_error(made):
    lost = [swept(1, seed, 0.0, 0.0, "It diverged.") for seed in (0, 1)]
    done, _ = made(*lost, swept(4, 0, 9e-3, 3.0), swept(4, 1, 0.0, 0.0, "It diverged."))
    assert done.returncode == 0
    assert [line.split() for line in done.stdout.splitlines()[:3]] == [
        ["H", "R", "free", "run", "failed"],
        ["1", "–", "–", "2"],
        ["4", "9.000", "mΩ", "3.00", "A", "1"],
    ]
    assert done.stderr.splitlines()[0] == "seed 0, H = 1: It diverged., 12 s"
    assert made(*lost, horizons="1")[0].returncode == 1
