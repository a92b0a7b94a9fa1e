"""Memory that a computation takes, refused before it begins where there is not as much."""

import os
from pathlib import Path

from penode.errors import InputError

#: Where Linux says how much can be had without swapping, and how much a container may.
_MEMINFO = Path("/proc/meminfo")
_LIMIT, _TAKEN = (Path("/sys/fs/cgroup") / name for name in ("memory.max", "memory.current"))


def require_memory(samples: int, each: int) -> None:
    """Refuse more samples, of ``each`` bytes, than there is free memory for."""
    free = free_memory()
    if free is None or samples * each <= free:
        return
    raise InputError(
        f"{samples} samples take about {samples * each / 1e9:.3g} GB of memory where "
        f"{free / 1e9:.3g} GB are free; ask for fewer, samples = {free // each} in the study file."
    )


def free_memory() -> int | None:
    """Return the bytes of memory that can be had, None where the system does not say."""
    try:
        lines = dict(line.split(":") for line in _MEMINFO.read_text().splitlines())
        free = 1024 * int(lines["MemAvailable"].split()[0])
    except (OSError, ValueError, KeyError):
        try:
            free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        except (AttributeError, ValueError, OSError):  # Windows
            return None
    try:
        return min(free, int(_LIMIT.read_text()) - int(_TAKEN.read_text()))
    except (OSError, ValueError):  # no container, or one without a limit
        return free
