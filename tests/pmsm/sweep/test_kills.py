"""kill -9 at random moments of a sweep whose fits are given: nothing half written, nothing lost."""

import subprocess
import sys

import pytest

# Children are forked from a server that has imported everything and begun nothing.
SCRIPT = """
import multiprocessing, sys, time
from pathlib import Path

import numpy as np

from penode.fit.result_folder import claimed
from penode.pmsm.sweep.campaign import Campaign, Recorded
from penode.pmsm.sweep.run import sweep
from penode.pmsm.sweep.task import Outcome

FOLDER = Path(sys.argv[1])
KILLS = 50


def workers(tasks):
    for task in tasks:
        content = task.key.encode() * 20_000
        values = {"status": "done", "R": int(task.key, 16) / 3, "reason": "long " * 400}
        yield task, Outcome(values, {"fit/fit.json": content, "result.json": content})


def do(out):
    files = [Recorded(f"{n}.csv", (FOLDER / f"{n}.csv",)) for n in range(6)]
    with claimed(FOLDER / out):
        for _ in sweep(Campaign(tuple(files), seeds=tuple(range(10))), FOLDER / out, workers):
            pass


def contents(out):
    folder = FOLDER / out
    found = {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    lines = found.pop(Path("table.jsonl")).splitlines()
    return found, sorted(lines)


if __name__ == "__main__":
    for n in range(6):
        (FOLDER / f"{n}.csv").write_text(str(n))
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(["__main__", "penode.pmsm.sweep.run"])

    def start(out):
        child = server.Process(target=do, args=(out,))
        child.start()
        return child

    start("first").join()
    began = time.monotonic()
    start("whole").join()
    took, random, kills, sweeps, rows = time.monotonic() - began, np.random.default_rng(0), 0, 0, []
    while kills < KILLS:
        out, child = f"killed{sweeps}", None
        while child is None or child.exitcode:
            child = start(out)
            child.join(timeout=random.uniform(0, took / 2) if kills < KILLS else None)
            if child.is_alive():
                child.kill()
                child.join()
                kills += 1
                table = FOLDER / out / "table.jsonl"
                rows.append(table.read_bytes().count(b"\\n") if table.exists() else 0)
        sweeps += 1
        assert contents(out) == contents("whole"), out
        assert not list((FOLDER / out).rglob(".*"))
    print(kills, "kills of", sweeps, "sweeps; rows at each:", *rows)
    assert len({row for row in rows if 0 < row < 60}) > 5, "killed at too few places"
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="No server that forks.")
def test_fifty_kills_at_random_moments_change_nothing(tmp_path):
    script = tmp_path / "kills.py"
    script.write_text(SCRIPT)
    command = [sys.executable, script, tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "kills of" in done.stdout
