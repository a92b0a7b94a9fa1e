"""Content: the bytes of a file, read once and hashed on the way."""

import hashlib
import mmap
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from penode.data.gathered import on_disk
from penode.errors import InputError

_BLOCK = 1 << 20
#: Bytes from which a file is copied to disk rather than into memory.
_LARGE = 1 << 26
#: Bytes at its begin of which some format has one that is not zero.
_HEAD = 1 << 13


class Content(AbstractContextManager["Content"]):
    """The bytes of a regular file, to be read once, in a ``with`` block.

    What was hashed is what was parsed: the file is not opened a second time. Refuses a directory, a
    pipe, a device, and a file that begins with nothing but zeros: one whose space a recorder
    reserved and never wrote.
    """

    def __init__(self, file: str) -> None:
        location = Path(file)
        if location.exists() and not location.is_file():
            what = "a directory" if location.is_dir() else "a pipe or a device"
            raise InputError(f"{file}: this is {what}; name a file.")
        self.file = file
        self._opened = location.open("rb", buffering=0)
        self.size = os.fstat(self._opened.fileno()).st_size
        self._digest = hashlib.sha256()
        head = self._opened.read(_HEAD)
        self._opened.seek(0)
        if len(head) == _HEAD and not any(head):
            self._opened.close()
            raise InputError(
                f"{self.file}: the first {_HEAD} bytes are zeros, as in a file that was never "
                "written; copy the file again, or record again."
            )

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def blocks(self) -> Iterator[bytes]:
        """Yield the bytes of the file in order; refuse it if its size has changed since."""
        count = 0
        while block := self._opened.read(min(_BLOCK, self.size + 1 - count)):
            count += len(block)
            if count > self.size:
                break
            self._digest.update(block)
            yield block
        if count != self.size:
            raise InputError(
                f"{self.file}: the file changed while it was read; wait until it is written, "
                "then read it again."
            )

    def all(self) -> bytes:
        """Return the bytes of the file; see `blocks`."""
        return b"".join(self.blocks())

    def mapped(self) -> bytes | mmap.mmap:
        """Return the bytes of the file; those of a large one lie in a copy on disk."""
        return self.all() if self.size < _LARGE else on_disk(self.blocks())

    @property
    def sha256(self) -> str:
        """Digest of the bytes that were read."""
        return self._digest.hexdigest()
