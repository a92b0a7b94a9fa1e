"""Decoders of binary files that serve all tests: a child for each file would cost a second."""

from collections.abc import Callable, Iterator

import pytest

from penode.data.isolation import Decoder
from penode.data.table import Table


@pytest.fixture(scope="session")
def decode() -> Iterator[Callable[[str, str, bytes], Table]]:
    """Return a function of a reader, a file's name and its content."""
    running: dict[str, Decoder] = {}

    def table(reader: str, file: str, content: bytes) -> Table:
        decoder = running.get(reader)
        if decoder is None or not decoder.alive:
            decoder = running[reader] = Decoder(reader)
        return decoder.read(file, len(content), [content])

    yield table
    for decoder in running.values():
        decoder.close()
