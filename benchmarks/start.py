"""How long a person waits for the first page: ``python -m benchmarks.start``.

Each figure is the shortest of several runs, each in a process of its own: help and completion are
interrupted by other work on the machine more than they differ.
"""

import os
import subprocess
import sys
import time

from benchmarks.problem import verdict

_RUNS = 7
_PROGRAM = (sys.executable, "-m", "penode_launcher")
#: What is asked -> its command, the words typed before TAB, most seconds.
ASKED: dict[str, tuple[tuple[str, ...], str, float]] = {
    "penode --help": ((*_PROGRAM, "--help"), "", 0.7),
    "penode identify --help": ((*_PROGRAM, "identify", "--help"), "", 0.7),
    "penode TAB": (_PROGRAM, "penode ", 0.4),
    "penode identify --TAB": (_PROGRAM, "penode identify --", 0.4),
    "import penode": ((sys.executable, "-c", "import penode"), "", 0.4),
}


def seconds(command: tuple[str, ...], typed: str) -> float:
    """Return the shortest time in s of a command, or of the completion of words."""
    environment = dict(os.environ)
    if typed:
        last = str(len(typed.split(" ")) - 1)
        environment |= {"_PENODE_COMPLETE": "complete_bash", "COMP_WORDS": typed}
        environment["COMP_CWORD"] = last
    taken = []
    for _ in range(_RUNS):
        began = time.perf_counter()
        subprocess.run(command, env=environment, capture_output=True, check=True)
        taken.append(time.perf_counter() - began)
    return min(taken)


def main() -> int:
    """Print each time beside what it may be."""
    good = True
    for name, (command, typed, most) in ASKED.items():
        taken = seconds(command, typed)
        good &= taken <= most
        print(f"{name:24} {taken:6.2f} s   at most {most} s: {verdict(taken <= most)}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
