"""Columns that may be longer than memory: gathered piece by piece, on disk from some length on.

A column on disk is an array like any other, mapped from a temporary file that vanishes with it.
Only the pages that are in use take memory.
"""

import mmap
import tempfile
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

import numpy as np

from penode.data.table import Column
from penode.errors import InputError

#: Values from which on a column is kept on disk, and values in a piece.
MANY, PIECE = 1 << 20, 1 << 18


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
        if self._count > MANY:
            self._write()

    def whole(self) -> Column:
        """Return all values, shape (time,), and let go of them; read-only where on disk."""
        parts, self._parts = self._parts, []
        if self._file is None:
            return np.concatenate(parts) if parts else np.empty(0)
        opened, self._file = self._file, None
        with opened:
            mapped = mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ)
        return np.frombuffer(mapped, dtype=np.float64)

    def _write(self) -> None:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(prefix="penode-")  # noqa: SIM115 (kept open)
        except OSError as error:
            raise _no_room(error) from error
        for part in self._parts:
            write(self._file, np.ascontiguousarray(part, dtype=np.float64).data)
        self._parts.clear()


def write(file: BinaryIO, content: bytes | memoryview) -> None:
    """Write to a temporary file; refuse it if the disk is full."""
    try:
        file.write(content)
        file.flush()
    except OSError as error:
        raise _no_room(error) from error


def _no_room(error: OSError) -> InputError:
    return InputError(
        f"the folder {tempfile.gettempdir()} for temporary files cannot take the recording "
        f"({error.strerror}); set TMPDIR to a folder on a larger disk."
    )


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


def released(values: Column) -> Column:
    """Return an array whose pages are given back to the system, where it lies in a file."""
    mapped = mapping_of(values)
    if mapped is not None:
        forget(mapped)
    return values


def forget(mapped: mmap.mmap) -> None:
    """Give the pages of a file back to the system, where it can be told to."""
    if hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)
