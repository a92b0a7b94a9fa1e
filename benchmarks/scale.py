"""Memory and time of commands over the length of a recording: ``python -m benchmarks.scale``.

Each figure is of a process of its own: its peak resident memory (the larger one, of it and of the
process that decodes its file), what it computed for, and the time by the clock, which other work on
the machine makes longer.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.long_recording import channels, write
from benchmarks.problem import verdict
from penode.data import gathered
from penode.data.load import load

SAMPLES = (100_000, 1_000_000, 10_000_000)
#: Command and samples -> most MB and s that they may take.
BUDGETS = {
    ("check", 10_000_000): (1000, 30),
    ("identify", 1_000_000): (1500, 90),
    ("identify", 10_000_000): (3000, 600),
}
_FEW = 50_000


@dataclass(frozen=True)
class Cost:
    """What a process took: MB at its peak, s of processors, s by the clock."""

    memory: float
    processor: float
    clock: float


def cost(module: str, arguments: list[str]) -> Cost:
    """Run a module and return what it took."""
    began = time.monotonic()
    command = [sys.executable, "-m", module, *arguments]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(running.pid, 0)
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f"{module} {' '.join(arguments)} ended with status {status}.")
    seconds = usage.ru_utime + usage.ru_stime
    return Cost(usage.ru_maxrss * 1024 / 1e6, seconds, time.monotonic() - began)


def check(folder: Path) -> None:
    """Refuse to go on unless a file read in pieces holds what was written in pieces."""
    file = folder / "few.parquet"
    write(file, _FEW, piece=7_000)
    gathered.MANY, gathered.PIECE = 1_000, 3_000
    run, wanted = load(file), [channels(first, 7_000) for first in range(0, _FEW, 7_000)]
    for name, values in run.channels.items():
        parts = np.concatenate([piece[name] for piece in wanted])[:_FEW]
        if not np.array_equal(values[:49_000], parts[:49_000]):
            raise SystemExit(f"{name} differs from what was written; nothing is measured.")


def main() -> None:
    """Print a row for each command and length."""
    print("| command | samples | peak | processor | clock | |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        check(Path(folder))
        for samples in SAMPLES:
            file = Path(folder) / "long.parquet"
            write(file, samples)
            commands = {"check": [], "identify": ["--out", f"{folder}/result"]}
            for name, options in commands.items():
                taken = cost("penode_launcher", [name, str(file), *options])
                print(
                    f"| {name} | {samples} | {taken.memory:.0f} MB | {taken.processor:.0f} s "
                    f"| {taken.clock:.0f} s | {_against_budget(name, samples, taken)} |",
                    flush=True,
                )


def _against_budget(name: str, samples: int, taken: Cost) -> str:
    memory, seconds = BUDGETS.get((name, samples), (np.inf, np.inf))
    if not np.isfinite(memory):
        return ""
    good = taken.memory < memory and taken.clock < seconds
    return f"below {memory} MB and {seconds} s {verdict(good)}"


if __name__ == "__main__":
    main()
