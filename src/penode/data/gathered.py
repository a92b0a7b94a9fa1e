"""Columns that may be longer than memory: gathered piece by piece, on disk from some length on.

A column on disk is an array like any other, mapped from a temporary file that vanishes with it.
Only the pages that are in use take memory. What has to be held in memory at once is refused before
it is tried where there is less.
"""

import mmap
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from penode.data.table import Column
from penode.errors import InputError

#: Values from which on a column is kept on disk, and values in a piece.
MANY, PIECE = 1 << 20, 1 << 18
#: Where Linux says how much can be had without swapping, and how much a container may.
_MEMINFO = Path("/proc/meminfo")
_LIMIT, _TAKEN = (Path("/sys/fs/cgroup") / name for name in ("memory.max", "memory.current"))


class Gathered:
    """A column that comes in pieces."""

    def __init__(self) -> None:
        self._parts: list[Column] = []
        self._count = 0
        self._file: Any = None

    def __len__(self) -> int:
        return self._count

    def add(self, values: Column) -> None:
        """Add the next values, (time,); refuse them if the disk is full."""
        self._parts.append(values)
        self._count += len(values)
        if self._count <= MANY:
            return
        with _disk_space():
            if self._file is None:
                self._file = tempfile.TemporaryFile(prefix="penode-")  # noqa: SIM115 (kept open)
        for part in self._parts:
            write(self._file, np.ascontiguousarray(part, dtype=np.float64).data)
        self._parts.clear()

    def whole(self) -> Column:
        """Return all values, shape (time,), and let go of them; read-only where on disk."""
        parts, self._parts = self._parts, []
        if self._file is None:
            return np.concatenate(parts) if parts else np.empty(0)
        opened, self._file = self._file, None
        with opened:
            mapped = mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ)
        return np.frombuffer(mapped, dtype=np.float64)


def on_disk(blocks: Iterable[bytes]) -> bytes | mmap.mmap:
    """Return bytes as a file on disk, which vanishes with them."""
    with tempfile.TemporaryFile(prefix="penode-") as copy:
        for block in blocks:
            write(copy, block)
        empty = copy.tell() == 0
        return b"" if empty else mmap.mmap(copy.fileno(), 0, access=mmap.ACCESS_READ)


def write(file: BinaryIO, content: bytes | memoryview) -> None:
    """Write to a temporary file; refuse it if the disk is full."""
    with _disk_space():
        file.write(content)
        file.flush()


@contextmanager
def _disk_space() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            f"the folder {tempfile.gettempdir()} for temporary files cannot take the recording "
            f"({error.strerror}); set TMPDIR to a folder on a larger disk."
        ) from error


def gathered(values: Column) -> Column:
    """Return values, (time,), as they are, or, where they are many, from disk."""
    return values if mapping_of(values) is not None else in_pieces(lambda piece: piece, values)


def in_pieces(function: Callable[..., Column], *columns: Column) -> Column:
    """Return a function of columns, (time,) each, sample by sample, on disk where they are many."""
    if len(columns[0]) <= MANY:
        return function(*columns)
    result = Gathered()
    for parts in zip(*map(pieces, columns), strict=True):
        result.add(function(*parts))
    return result.whole()


def pieces(values: Column) -> Iterator[Column]:
    """Yield an array, (time,), in pieces, of which those before leave no page in memory."""
    for first in range(0, len(values), PIECE):
        yield values[first : first + PIECE]
        released(values)


def mapping_of(values: Column) -> mmap.mmap | None:
    """Return the file that an array lies in, None where it lies in memory."""
    held: Any = values
    while isinstance(held, np.ndarray):
        held = held.base
    held = held.obj if isinstance(held, memoryview) else held
    return held if isinstance(held, mmap.mmap) else None


def released(values: Column) -> None:
    """Give the pages of an array back to the system, where it lies in a file."""
    mapped = mapping_of(values)
    if mapped is not None:
        forget(mapped)


def forget(mapped: mmap.mmap) -> None:
    """Give the pages of a file back to the system, where it takes such advice."""
    if hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def require_memory(samples: int, each: int) -> None:
    """Refuse more samples, of ``each`` bytes, than there is free memory for."""
    free = free_memory()
    if free is not None and samples * each > free:
        raise InputError(
            f"{samples} samples take about {samples * each / 1e9:.3g} GB of memory where "
            f"{free / 1e9:.3g} GB are free; ask for fewer, samples = {free // each} in the study "
            "file."
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
