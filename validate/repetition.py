"""One identification many times: ``python -m validate.repetition [COUNT]``.

A short recording with noise is identified COUNT times by the command, all of it left to the data.
During every second one, busy processes take the cores away in bursts. All have to give one
``result.json`` but for times: the same verdict, the same digits, the same bytes of arrays and map.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from penode.bench.drive import Drive
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.save import save
from penode.fit.archive import sha256, to_json
from validate.interruption import numbers
from validate.processes import ended_children

COUNT = 100
_PROGRAM = (sys.executable, "-m", "penode_launcher", "identify", "run.csv", "--out", "out")
_TIMES = ("wall_time_s", "training_time_s")
#: Takes a core in bursts, for as long as there is a parent.
_BURN = """
import os, time
parent = os.getppid()
while os.getppid() == parent:
    end = time.monotonic() + 0.3
    while time.monotonic() < end:
        pass
    time.sleep(0.1)
"""


@contextmanager
def loaded(really: bool) -> Iterator[None]:
    """Keep a busy process a core beside what is done within."""
    count = (os.cpu_count() or 1) if really else 0
    busy = [subprocess.Popen([sys.executable, "-c", _BURN]) for _ in range(count)]
    try:
        yield
    finally:
        for one in busy:
            one.kill()
            one.wait()


def content(out: Path) -> dict[str, str]:
    """Return the digests of what a result says, without its times."""
    result: dict[str, Any] = json.loads((out / "result.json").read_text())
    for name in _TIMES:
        result["provenance"].pop(name, None)
    result["files"].pop("fit/fit.json")  # it has times too, and is compared by what is in it
    document, arrays = numbers(out)
    return {
        "result.json": sha256(to_json(result).encode()),
        "fit.json": sha256(to_json(document).encode()),
        "fit.npz": sha256(b"".join(arrays[name] for name in sorted(arrays))),
        "flux_map.csv": sha256((out / "flux_map.csv").read_bytes()),
    }


def main(count: int = COUNT) -> None:
    """Print a line a repetition, and end with status 1 if there is more than one result."""
    results: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        drive = Drive(current_noise=0.2)
        reference = Lissajous(240.0, 50.0, 54.0)
        run = simulate(TRACTION_300A, reference, speed_rpm=700.0, duration=0.12, drive=drive)
        save(run, folder / "run.csv")
        for number in range(count):
            before, began = ended_children(), time.monotonic()
            with loaded(number % 2 == 1):
                done = subprocess.run(_PROGRAM, cwd=folder, capture_output=True, text=True)
                took = time.monotonic() - began
            said = content(folder / "out") if done.returncode in (0, 1) else {"": done.stderr}
            results[json.dumps(said)] += 1
            state = "loaded" if number % 2 else "alone"
            spent = ended_children() - before if number % 2 == 0 else float("nan")
            digest = " ".join(f"{name} {text[:12]}" for name, text in said.items())
            print(
                f"{number:3d} {state:6s} {took:6.1f} s, processor {spent:5.1f} s, "
                f"status {done.returncode}, {digest}",
                flush=True,
            )
    print(f"{count} repetitions, {len(results)} result{'s' * (len(results) > 1)}")
    sys.exit(len(results) != 1)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
