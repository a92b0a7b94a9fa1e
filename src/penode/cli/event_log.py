"""The log of a training that a program can read."""

import json
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

from penode.fit.archive import write_atomically


class EventLog:
    """Writes events to ``events.jsonl``, a line each, from the first one on; appends on resuming.

    Folder and file are made only when there is something to log: bad input leaves nothing behind.
    """

    def __init__(self, folder: Path, append: bool = False):
        self._path = folder / "events.jsonl"
        self._append = append
        self._file: TextIO | None = None
        self._before: bytes | None = None
        self._logged: set[int] = set()  # horizons whose rungs the log of before has
        self._began = time.monotonic()

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Log one event, unless it repeats a rung that was taken over."""
        file = self._file or self._open()
        if event["event"] == "resume":
            self._logged &= set(event["horizons"])
        if event["event"] == "rung" and event["horizon"] in self._logged:
            return
        elapsed = round(time.monotonic() - self._began, 3)
        file.write(json.dumps({"elapsed_s": elapsed, **event}) + "\n")
        file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def discard(self) -> None:
        """Put back what was there before: an earlier log, or no file."""
        self.close()
        if self._file is None:
            return
        if self._before is not None:
            write_atomically(self._path, self._before)
            return
        self._path.unlink(missing_ok=True)

    def _open(self) -> TextIO:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._before = self._path.read_bytes() if self._path.exists() else None
        if self._append and self._before is not None:
            self._logged = _rungs(self._before)
        self._file = self._path.open("a" if self._append else "w")
        return self._file


def _rungs(log: bytes) -> set[int]:
    """Return the horizons whose rungs a log records, whatever else is in it."""
    return {int(horizon) for horizon in re.findall(rb'"event": "rung", "horizon": (\d+)', log)}
