"""Processes as the system shows them: their children and the processor time they have taken."""

import os
from pathlib import Path


def children(process: int) -> list[int]:
    """Return the processes that the main thread of a process has started and that still run."""
    try:
        found = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except OSError:
        return []
    return [int(one) for one in found]


def tree(process: int) -> list[int]:
    """Return a process and all that it and its children have started."""
    return [process, *(one for child in children(process) for one in tree(child))]


def spent(process: int) -> float:
    """Return the seconds of processor time that a process has taken, 0 once it has ended."""
    try:
        entries = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(entries[11]) + int(entries[12])) / os.sysconf("SC_CLK_TCK")


def ended_children() -> float:
    """Return the seconds of processor time that children of this process took that have ended."""
    now = os.times()
    return now.children_user + now.children_system
