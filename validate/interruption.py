"""Kills and Ctrl-C at random moments: ``python -m validate.interruption [COUNT] [SEED]``.

One short recording is simulated and identified without interruption. Then COUNT identifications are
killed at a random moment and resumed, and each has to end with the numbers of the unbroken one, to
the last bit. COUNT more are sent Ctrl-C, and each has to end with one sentence, exit status 130 and
a whole result or none. Moments are seconds of processor time, which work beside does not shift.
"""

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.save import save
from penode.errors import InputError
from penode.fit.archive import read_archive
from penode.fit.fit import Fit
from validate.processes import ended_children, spent

COUNT = 10
#: What a run of the same fit may say otherwise: when and by which command it was made.
_OWN = ("command", "wall_time_s", "training_time_s")
_PROGRAM = (sys.executable, "-m", "penode_launcher")
#: Processor time in s in which Python itself starts; no program can answer a signal before.
_PYTHON = 0.1
_LOOK = 0.01
_ASKED = ("--horizon", "18", "--no-inverter", "--angle-orders", "none")


@dataclass(frozen=True)
class Ended:
    """A process that ended: exit status, what it said, and its processor time in s."""

    status: int
    said: str
    took: float


def identify(
    recording: Path, out: Path, *more: str, at: float = np.inf, send: int = signal.SIGKILL
) -> Ended:
    """Identify in a process of its own, and send it a signal after so many seconds of work."""
    command = [*_PROGRAM, "identify", str(recording), *_ASKED, "--out", str(out), *more]
    before = ended_children()
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        while process.poll() is None and spent(process.pid) < at:
            time.sleep(_LOOK)
        process.send_signal(send)
        _, said = process.communicate()
    return Ended(process.returncode, said, ended_children() - before)


def numbers(out: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the document and the arrays of a saved fit, without what is a run's own."""
    document, arrays = read_archive(out / "fit")
    for name in _OWN:
        document["provenance"]["mapping"].pop(name, None)
    return document, {name: values.tobytes() for name, values in arrays.items()}


def rungs(out: Path) -> int:
    """Return how many horizons a stopped fit has kept."""
    path = out / "fit" / "checkpoint.json"
    return len(json.loads(path.read_text())["rungs"]) if path.exists() else 0


def killed(recording: Path, folder: Path, whole: Ended, moments: np.ndarray) -> Iterator[bool]:
    """Kill and resume, and say of each whether it ended as the unbroken one."""
    wanted = numbers(folder / "whole")
    print("killed at   kept  resumed: status, took   as the unbroken one")
    for number, at in enumerate(moments):
        out = folder / f"killed{number}"
        ended = identify(recording, out, at=at)
        kept = rungs(out)
        again = identify(recording, out, "--resume", "--overwrite")
        same = again.status == whole.status and numbers(out) == wanted
        left = [path.name for path in out.rglob(".*")]
        verdict = "yes" if same and not left else f"NO {left} {again.said.strip()}"
        state = f"{at:7.2f} s" if ended.status < 0 else f"({ended.took:5.1f} s)"
        print(f"{state} {kept:6d} {again.status:9d} {again.took:10.1f} s   {verdict}", flush=True)
        yield same and not left


def stopped(recording: Path, folder: Path, moments: np.ndarray) -> Iterator[bool]:
    """Press Ctrl-C, and say of each whether it ended as it should."""
    print("Ctrl-C at   status   result   said")
    for number, at in enumerate(moments):
        out = folder / f"stopped{number}"
        ended = identify(recording, out, at=at, send=signal.SIGINT)
        try:
            found = Fit.load(out).horizon.verdict
        except InputError:
            # Horizons may be kept before there is a result of them.
            nothing = rungs(out) > 0 and not (out / "result.json").exists()
            found = "kept" if nothing else "BROKEN" if out.exists() else "none"
        lines = ended.said.splitlines()
        good = found != "BROKEN" and (ended.status, len(lines)) in ((130, 1), (0, 0))
        print(
            f"{at:7.2f} s {ended.status:8d} {found:>9} "
            f"  {' | '.join(lines)}{'' if good else '   NOT AS IT SHOULD BE'}",
            flush=True,
        )
        yield good


def main(count: int = COUNT, seed: int = 0) -> None:
    """Print both tables, and end with status 1 if one row is wrong."""
    random = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        recording = folder / "run.csv"
        reference = Lissajous(240.0, 50.0, 54.0)
        save(simulate(TRACTION_300A, reference, speed_rpm=1500.0, duration=0.25), recording)
        identify(recording, folder / "warm")  # compiles; the others find its programs
        whole = identify(recording, folder / "whole")
        print(f"unbroken: status {whole.status}, {whole.took:.1f} s")
        rows = [
            *killed(recording, folder, whole, random.uniform(0, whole.took, count)),
            *stopped(recording, folder, random.uniform(_PYTHON, whole.took, count)),
        ]
    print(f"{sum(rows)} of {len(rows)} as they should be")
    if not all(rows):
        sys.exit(1)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
