"""Isolation: binary files are decoded in a child process with limits on memory and time.

Libraries for binary formats trust their input. A damaged file makes them crash, loop or ask for
more memory than there is, and one made for the purpose could do worse. The child gets the bytes of
one file and answers with columns of numbers.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from penode.data.content import Content
from penode.data.gathered import PIECE, Gathered, write
from penode.data.table import Column, Table
from penode.errors import InputError, printable

_CHILD = Path(__file__).with_name("isolated_decoder.py")
_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",  # threads that have nothing to do cost memory
    "NUMEXPR_MAX_THREADS": "1",
    "HDF5_PLUGIN_PRELOAD": "::",  # load no filter that a file asks for
}
#: What each reader imports, which counts neither as memory nor as time of a file.
_LIBRARIES = {
    "mat": (),
    "mdf": ("asammdf",),
    "parquet": (),
    "tdms": ("nptdms",),
    "xlsx": ("openpyxl",),
}

#: Bytes that a file may take to decode, and those for each of its own bytes.
_MEMORY = 3 << 29
_MEMORY_PER_BYTE = 8
#: Seconds of computing that a file may take, and those for each of its bytes.
_SECONDS = 3
_SECONDS_PER_BYTE = 1e-6
#: Seconds by the clock for each of computing: the machine has other things to do.
_WAIT = 20
_HEADER = 1 << 26
_OUT_OF_MEMORY = 3


def isolated(reader: str) -> Callable[[Content], Table]:
    """Return a reader, by module name in `penode.data.readers`, that runs in a process of its own.

    It raises InputError if the reader refuses the file, crashes, or takes too much memory or time.
    """

    def read(content: Content) -> Table:
        with Decoder(reader) as decoder:
            return decoder.read(content.file, content.size, content.blocks())

    return read


class Decoder(AbstractContextManager["Decoder"]):
    """A child process that decodes files one after the other, in a ``with`` block.

    ``reader`` is the name of a module of `penode.data.readers`.
    """

    def __init__(self, reader: str) -> None:
        self._reader = reader
        self._expired = False
        self._folder = tempfile.TemporaryDirectory(prefix="penode-", ignore_cleanup_errors=True)
        self._child = subprocess.Popen(
            [sys.executable, "-P", str(_CHILD), self._folder.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ENVIRONMENT, "TMPDIR": self._folder.name},
        )

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the child."""
        self._child.kill()
        for pipe in (self._child.stdin, self._child.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        self._child.wait()
        self._folder.cleanup()

    @property
    def process(self) -> int:
        """Number of the child."""
        return self._child.pid

    @property
    def alive(self) -> bool:
        """Whether the child can take another file."""
        return self._child.poll() is None

    def read(self, file: str, size: int, blocks: Iterable[bytes]) -> Table:
        """Decode one file of ``size`` bytes; refuse it as `isolated` does."""
        memory = _MEMORY + _MEMORY_PER_BYTE * size
        seconds = _SECONDS + int(_SECONDS_PER_BYTE * size)
        content = Path(self._folder.name) / "content"
        request = {
            "reader": self._reader,
            "libraries": _LIBRARIES[self._reader],
            "path": [str(place) for place in sys.path],
            "file": file,
            "content": str(content),
            "memory": memory,
            "seconds": seconds,
        }
        with content.open("wb") as copy:
            for block in blocks:  # all of the file, so that all is hashed and checked
                write(copy, block)
        timer = threading.Timer(_WAIT * seconds, self._expire)
        timer.daemon = True
        timer.start()
        try:
            assert self._child.stdin is not None
            with contextlib.suppress(OSError):  # a child that ended shows when it has to answer
                self._child.stdin.write(json.dumps(request).encode() + b"\n")
                self._child.stdin.flush()
            columns, header = self._answer(memory)
        except (_EndedError, MemoryError) as error:
            raise InputError(f"{file}: {self._reason(memory, seconds)}") from error
        finally:
            timer.cancel()
        if "refused" in header:
            raise InputError(header["refused"])
        if header.get("failed") == "MemoryError":
            raise InputError(f"{file}: {_too_large(memory)}")
        if "failed" in header:
            raise InputError(
                f"{file}: the file is damaged, or of a kind that penode cannot read "
                f"({printable(header['failed'])}); copy or export it again."
            )
        parts = ("units", "clocks", "text", "left_out", "numbers")
        return Table(columns, *(header[part] for part in parts))

    def _expire(self) -> None:
        self._expired = True
        self._child.kill()

    def _answer(self, memory: int) -> tuple[dict[str, Column], dict[str, Any]]:
        """Return the columns and the end of the answer, which have to be what they should."""
        columns: dict[str, Column] = {}
        left = memory
        while "column" in (entry := self._entry()):
            left -= 8 * entry["length"]
            if entry["length"] < 0 or left < 0:
                raise _EndedError
            column, missing = Gathered(), entry["length"]
            while missing:
                column.add(self._values(min(PIECE, missing)))
                missing = entry["length"] - len(column)
            columns[entry["column"]] = column.whole()  # on disk where they are many
        return columns, entry

    def _entry(self) -> dict[str, Any]:
        """Return the next line of the answer: the head of a column, or the end."""
        assert self._child.stdout is not None
        line = self._child.stdout.readline(_HEADER)
        try:
            entry = json.loads(line)
            if "column" in entry:
                return {"column": str(entry["column"]), "length": int(entry["length"])}
            if "refused" in entry or "failed" in entry:
                return dict(entry)
            for name in ("units", "clocks", "left_out"):
                entry[name] = {str(column): str(text) for column, text in entry[name].items()}
            entry["numbers"] = {str(n): float(value) for n, value in entry["numbers"].items()}
            entry["text"] = {
                n: (str(place), str(cell)) for n, (place, cell) in entry["text"].items()
            }
            return dict(entry)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise _EndedError from error

    def _values(self, length: int) -> Column:
        assert self._child.stdout is not None
        values = np.empty(length, dtype="<f8")
        room = values.view(np.uint8).data
        if self._child.stdout.readinto(room) != values.nbytes:  # type: ignore[attr-defined]
            raise _EndedError
        return values

    def _reason(self, memory: int, seconds: int) -> str:
        """Return why the child ended before its answer did."""
        try:
            status = self._child.wait(timeout=1)
        except subprocess.TimeoutExpired:  # it answered, but not as it should
            self._child.kill()
            status = self._child.wait()
        if self._expired or -status == getattr(signal, "SIGXCPU", None):
            return (
                f"reading it took longer than {seconds} s of computing where a file of its size "
                "takes far less, so it is damaged; copy or export it again."
            )
        if status == _OUT_OF_MEMORY:
            return _too_large(memory)
        return (
            f"the library that reads such files crashed (status {status}), so the file is damaged, "
            f"or unpacks to more than {memory / 2**30:.1f} GiB; copy or export it again."
        )


def _too_large(memory: int) -> str:
    """Return why a file is refused that took more memory than it may."""
    return (
        f"reading it took more than {memory / 2**30:.1f} GiB of memory where a file of its size "
        "takes far less, so it is damaged or has much to unpack; copy or export it again, without "
        "compression."
    )


class _EndedError(Exception):
    """The child ended before its answer did."""
