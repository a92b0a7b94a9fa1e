"""The real command in a process of its own: how it ended, what it took, what it left behind."""

import hashlib
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from validate.processes import ended_children, spent, tree

PROGRAM = (sys.executable, "-m", "penode_launcher")
#: Bounds on what a refusal may take: processor time in s, and bytes of memory.
SECONDS, BYTES = 10.0, 1e9
#: Seconds of the processor, and by the clock of a busy machine, after which a command hangs.
_HANGS, _WAITS = 25.0, 300.0
_LOOK = 0.02


@dataclass(frozen=True)
class Ended:
    """A command that ended.

    Attributes
    ----------
    status : int
    said, printed : str
        What it wrote to standard error and standard output.
    seconds : float
        Of the processor, its children included.
    memory : float
        Bytes: the sum over its processes of the most that each has taken.
    left : tuple of str
        Files that were made, changed or removed.
    """

    status: int
    said: str
    printed: str
    seconds: float
    memory: float
    left: tuple[str, ...]


def run(arguments: list[str], folder: Path) -> Ended:
    """Run a command in a folder and look at all of the folder before and after.

    Parameters
    ----------
    arguments : list of str
        Of penode.
    folder : Path
        Where it runs; temporary files of the command are looked for in ``temporary`` beside.
    """
    temporary = folder.with_name("temporary")
    temporary.mkdir(exist_ok=True)
    before = {**_files(folder), **_files(temporary)}
    before_it = ended_children()
    process = subprocess.Popen(
        [*PROGRAM, *arguments],
        cwd=folder,
        env={**os.environ, "TMPDIR": str(temporary), "TERM": "dumb", "COLUMNS": "80"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    largest = _watched(process)
    printed, said = (text.decode("utf-8", "replace") for text in process.communicate())
    seconds = ended_children() - before_it
    after = {**_files(folder), **_files(temporary)}
    left = tuple(sorted(str(p) for p in before.keys() ^ after.keys()))
    left += tuple(sorted(str(p) for p in before.keys() & after.keys() if before[p] != after[p]))
    return Ended(process.returncode, said, printed, seconds, sum(largest.values()), left)


def _watched(process: subprocess.Popen[bytes]) -> dict[int, float]:
    """Wait for the end; return the largest memory of each process in bytes."""
    largest: dict[int, float] = {}
    limit = time.monotonic() + _WAITS
    while process.poll() is None:
        running = tree(process.pid)
        for one in running:
            largest[one] = _most(one) or largest.get(one, 0.0)
        if time.monotonic() > limit or sum(map(spent, running)) > _HANGS:
            process.kill()
        time.sleep(_LOOK)
    return largest


def _most(process: int) -> float:
    """Return the most memory that a process has taken since it began its program."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((1024.0 * int(line.split()[1]) for line in lines if line[:6] == "VmHWM:"), 0.0)


def _files(folder: Path) -> dict[Path, str]:
    """Return what is in a folder: paths, and digests of regular files that are not huge."""
    found = {}
    for path in folder.rglob("*"):
        kind = "link" if path.is_symlink() else "file" if path.is_file() else "other"
        small = kind == "file" and path.stat().st_size < 1 << 26
        found[path] = hashlib.sha256(path.read_bytes()).hexdigest() if small else kind
    return found
