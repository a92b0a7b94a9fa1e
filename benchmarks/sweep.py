"""Short fits by one process and by two: ``python -m benchmarks.sweep [COUNT]``.

COUNT recordings of a quarter of a second are swept at H = 1, by one process and by two. Both tables
have to be the same to the last bit. On idle cores the ratio of the times is what a second process
gains; on cores that others use, only processor times mean something. What a task costs beside its
fit is the processor time of the parent, and the time in which no task of a process ran. At last the
finished sweep is asked for once more.
"""

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl

from penode.bench.drive import DEFAULT_DRIVE
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.save import save
from penode.pmsm.sweep.table import FITS, LINES, PARQUET, TIMES

COUNT = 500
_PROGRAM = (sys.executable, "-m", "penode_launcher", "sweep")
_STUDY = """
inverter = false
angle_orders = []
[sweep]
recordings = ["*.csv"]
horizons = [1]
"""


@dataclass(frozen=True)
class Swept:
    """One sweep: its table, whole and processor time in s, and that of the parent alone."""

    table: pl.DataFrame
    took: float
    processor: float
    parent: float

    @property
    def fits(self) -> float:
        """Processor time of all fits in s."""
        return float(self.table["processor_seconds"].sum())


def record(folder: Path, count: int) -> None:
    """Simulate recordings of slightly different lengths, speeds and noise."""
    (folder / "study.toml").write_text(_STUDY)
    drive, reference = replace(DEFAULT_DRIVE, current_noise=0.05), Lissajous(240.0, 50.0, 54.0)
    for k in range(count):
        speed, duration = 1500.0 + k % 50, 0.25 + 1e-4 * (k % 100)
        run = simulate(
            TRACTION_300A, reference, speed_rpm=speed, duration=duration, drive=drive, seed=k
        )
        save(run, folder / f"{k:06d}.csv")


def sweep(folder: Path, out: Path, jobs: int) -> Swept:
    """Sweep in a process of its own."""
    study = ("--config", str(folder / "study.toml"), "--out", str(out), "--jobs", str(jobs))
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([*_PROGRAM, *study], check=True, capture_output=True)
    took, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    table = pl.read_parquet(out / PARQUET)
    return Swept(table, took, processor, processor - float(table["processor_seconds"].sum()))


def size(path: Path) -> float:
    """Return what a file or folder holds, in kB."""
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.stat().st_size for one in files) / 1e3


def main(count: int = COUNT) -> None:
    """Print times and sizes, and end with status 1 if the tables differ."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        record(folder, 3)
        sweep(folder, folder / "warm", 1)  # compiles; the others find its programs
        record(folder, count)
        one, two = (sweep(folder, folder / f"jobs{jobs}", jobs) for jobs in (1, 2))
        for jobs, swept in ((1, one), (2, two)):
            print(
                f"{jobs} jobs: {swept.took:7.1f} s, processor {swept.processor:7.1f} s, of fits "
                f"{swept.fits:7.1f} s ({swept.fits / count:.3f} s each, median "
                f"{swept.table['processor_seconds'].median():.3f} s); beside a fit "
                f"{swept.parent / count * 1e3:.0f} ms of processor"
            )
        print(f"one process / two: {one.took / two.took:.2f}x of the whole time")
        again = sweep(folder, folder / "jobs2", 2)
        print(f"all there: {again.took:.1f} s, of which a task {again.took / count * 1e3:.1f} ms")
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
        print(f"largest process: {memory:.0f} MB")
        for name in (LINES, PARQUET, FITS):
            print(f"{name}: {size(folder / 'jobs2' / name) / count:.2f} kB a task")
        same = one.table.drop(TIMES).equals(two.table.drop(TIMES))
        print(f"tables the same to the last bit: {'yes' if same else 'NO'}")
        if not same:
            sys.exit(1)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
