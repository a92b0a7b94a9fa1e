"""Kills at random moments of a sweep: ``python -m validate.sweep_interruption [COUNT] [SEED]``.

A few short recordings are swept by two processes without interruption. Then the same sweep is
killed COUNT times: up to four times at random moments before it is left to end; of some a worker is
killed instead. Each has to end with the table and the fits of the unbroken one to the last bit,
with nothing half written or left behind, and no worker may outlive its sweep.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.save import save
from penode.pmsm.sweep.table import FITS, LINES, PARQUET, TIMES
from validate.interruption import numbers

COUNT = 50
#: Kills of one sweep before it is left to end.
_KILLS = 4
#: Seconds in which Python itself starts, and the part of a whole sweep within which it is killed.
_PYTHON, _PART = 0.3, 0.6
_PROGRAM = (sys.executable, "-m", "penode_launcher", "sweep")
_STUDY = """
inverter = false
angle_orders = []
[sweep]
recordings = ["run*.csv"]
horizons = [1, 3]
seeds = 2
"""


def start(folder: Path, out: Path) -> subprocess.Popen[bytes]:
    """Begin or go on with a sweep in a process of its own."""
    study = ("--config", str(folder / "study.toml"), "--out", str(out), "--jobs", "2")
    nowhere = subprocess.DEVNULL
    return subprocess.Popen([*_PROGRAM, *study], stdout=nowhere, stderr=nowhere)


def result(out: Path) -> tuple[pl.DataFrame, dict[str, Any]]:
    """Return the table without times, and the content of every fit."""
    table = pl.read_parquet(out / PARQUET).drop(TIMES)
    return table, {key: numbers(out / FITS / key) for key in table["key"]}


def same(out: Path, wanted: tuple[pl.DataFrame, dict[str, Any]]) -> bool:
    """Return whether a sweep ended as the unbroken one, and left nothing else."""
    table, fits = result(out)
    hidden = [path for path in out.rglob("*") if path.name.startswith(".")]
    others = {path.name for path in (out / FITS).iterdir()} - set(table["key"])
    return table.equals(wanted[0]) and fits == wanted[1] and not hidden and not others


def workers_of(process: int) -> list[int]:
    """Return the processes whose parent is this one."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError, IndexError):
            continue
        if parent == process:
            found.append(int(entry.name))
    return found


def ended(processes: list[int], patience: float = 60.0) -> bool:
    """Return whether all of these end within some seconds: one that starts imports to the end."""
    limit = time.monotonic() + patience
    while time.monotonic() < limit:
        if not any(Path(f"/proc/{one}").exists() for one in processes):
            return True
        time.sleep(0.05)
    return False


def killed(folder: Path, out: Path, moments: np.ndarray, worker: bool) -> Iterator[str]:
    """Kill at each moment and go on; yield what was killed after how many rows."""
    for at in moments:
        process = start(folder, out)
        try:
            process.wait(timeout=at)
            break
        except subprocess.TimeoutExpired:
            pass
        workers = workers_of(process.pid)
        rows = (out / LINES).read_bytes().count(b"\n") if (out / LINES).exists() else 0
        when = f"{at:.1f} s, {rows} rows"
        if worker and workers:
            os.kill(workers[-1], signal.SIGKILL)
            yield f"worker at {when}"
            process.wait()
            break
        process.kill()
        process.wait()
        yield f"at {when}" if ended(workers) else f"WRONG: workers live on after {when}"
    process = start(folder, out)
    if process.wait():
        yield f"WRONG: status {process.returncode}"


def main(count: int = COUNT, seed: int = 0) -> None:
    """Print a line a sweep, and end with status 1 if one is not as it should be."""
    random = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "study.toml").write_text(_STUDY)
        for number, rate in enumerate((140.0, 130.0, 120.0)):
            reference = Lissajous(200.0, rate, 150.0)
            run = simulate(TRACTION_300A, reference, speed_rpm=150.0, duration=0.2)
            save(run, folder / f"run{number}.csv")
        start(folder, folder / "warm").wait()  # compiles; the others find its programs
        start(folder, folder / "whole").wait()
        began = time.monotonic()
        start(folder, folder / "again").wait()
        took, wanted = time.monotonic() - began, result(folder / "whole")
        print(f"unbroken: {len(wanted[0])} rows, {took:.1f} s", flush=True)
        kills, tried, good = 0, 0, True
        while kills < count:
            tried += 1
            out = folder / f"killed{tried}"
            moments = random.uniform(_PYTHON, took * _PART, min(_KILLS, count - kills))
            told = list(killed(folder, out, moments, worker=bool(random.integers(4) == 0)))
            fine = same(out, wanted) and not any("WRONG" in one for one in told)
            verdict = "as the unbroken one" if fine else "NOT AS IT SHOULD BE"
            print(f"{'; '.join(told)}: {verdict}", flush=True)
            kills, good = kills + len(told), good and fine
    print(f"{kills} kills, all as they should be" if good else "NOT AS IT SHOULD BE")
    if not good:
        sys.exit(1)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
