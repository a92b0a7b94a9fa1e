"""The table of a sweep: a line of JSON a row, appended as tasks end; Parquet when all have."""

import io
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import polars as pl

from penode.errors import InputError
from penode.fit.archive import name_file, write_atomically
from penode.pmsm.sweep.task import FAILED, LINES, MAP_COLUMNS, Outcome

PARQUET, FITS = "table.parquet", "fits"
#: What a row is called, whatever came of it.
LABELS = ("recording", "machine", "date", "variant", "horizon", "seed")
#: Rows that are made into columns together.
_BATCH = 5000
#: What differs between two runs of one task.
TIMES = ("seconds", "processor_seconds")

_TYPES: dict[str, Any] = {
    **dict.fromkeys(("key", "recording", "machine", "date", "variant"), pl.String),
    **dict.fromkeys(("horizon", "seed"), pl.Int64),
    "status": pl.String,
    **dict.fromkeys(("R", "R_std", "R_low", "R_high"), pl.Float64),
    "verdict": pl.String,
    "answered": pl.Boolean,
    "selected": pl.Int64,
    **dict.fromkeys((*MAP_COLUMNS, "rmse", "free_run_rmse"), pl.Float64),
    **dict.fromkeys(("objections", "reason"), pl.String),
    "warnings": pl.Int64,
    **dict.fromkeys(TIMES, pl.Float64),
    "error": pl.String,
}


class Table:
    """The rows in a folder, and the saved fits beside them; made by `open_table`.

    ``lines`` is ``table.jsonl``, open for reading and appending.
    """

    def __init__(self, folder: Path, lines: BinaryIO):
        self._folder, self._lines = folder, lines
        # Where the line of each task that is done begins, and the last task of each name.
        self._places: dict[str, int] = {}
        self._latest: dict[int, str] = {}
        place = 0
        for number, line in enumerate(lines, 1):
            if not line.endswith(b"\n"):
                lines.truncate(place)
                break
            self._learn(_parsed(line, folder / LINES, number), place)
            place += len(line)
        lines.seek(0, os.SEEK_END)

    def _learn(self, row: Mapping[str, Any], place: int) -> None:
        self._latest[_called(row)] = row["key"]
        if row["status"] != FAILED:
            self._places[row["key"]] = place

    def done(self, key: str) -> bool:
        """Return whether a task has ended for good."""
        return key in self._places

    def keep(self, key: str, labels: Mapping[str, Any], outcome: Outcome) -> dict[str, Any]:
        """Write what came of a task: the fit as one, then its line. Return the row."""
        if outcome.files:
            self._save(key, outcome.files)
        return self._append({"key": key, **labels, **outcome.values})

    def called(self, key: str, labels: Mapping[str, Any]) -> dict[str, Any]:
        """Return the row of a task that is done, written anew unless it is the last of its name."""
        self._lines.seek(self._places[key])
        row = {**json.loads(self._lines.readline()), **labels}
        return row if self._latest.get(_called(row)) == key else self._append(row)

    def _append(self, row: dict[str, Any]) -> dict[str, Any]:
        row = {name: _plain(value) for name, value in row.items()}
        place = self._lines.seek(0, os.SEEK_END)
        try:
            # One call a line: a reader sees whole lines, but for the last.
            self._lines.write(json.dumps(row, ensure_ascii=False).encode() + b"\n")
            self._lines.flush()
        except OSError as error:
            self._lines.truncate(place)
            name_file(error, self._folder / LINES)
            raise
        self._learn(row, place)
        return row

    def _save(self, key: str, files: Mapping[str, bytes]) -> None:
        fits = self._folder / FITS
        part, place = fits / f".{key}.part", fits / key
        try:
            for name, content in files.items():
                path = part / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            # There without a line in the table: the process ended between the two.
            shutil.rmtree(place, ignore_errors=True)
            part.rename(place)
        except BaseException as error:
            name_file(error, place)
            shutil.rmtree(part, ignore_errors=True)
            raise


@contextmanager
def open_table(folder: Path) -> Iterator[Table]:
    """Give the table of a folder that the caller claimed, what was left half written removed.

    Refuses a line that is not as it was written.
    """
    for left in (folder / FITS).glob(".*.part"):
        shutil.rmtree(left, ignore_errors=True)
    path = folder / LINES
    try:
        with path.open("a+b", buffering=0) as raw:
            raw.seek(0)
            yield Table(folder, io.BufferedRandom(raw))
    finally:
        if path.exists() and not path.stat().st_size:
            path.unlink()


def write_parquet(called: Iterable[Mapping[str, Any]], folder: Path) -> None:
    """Write ``table.parquet``: the last row of each name, in the order of the names.

    ``called`` has the labels of every row of a campaign.
    """
    wanted = {name: _TYPES[name] for name in LABELS}
    order = pl.DataFrame(list(called), schema=wanted)
    rows = _last_lines(folder / LINES, (folder / LINES).read_bytes())
    buffer = io.BytesIO()
    joined = order.join(rows, on=LABELS, how="left", nulls_equal=True, maintain_order="left")
    joined.select(rows.columns).write_parquet(buffer)
    write_atomically(folder / PARQUET, buffer.getvalue())


def read_table(folder: Path) -> pl.DataFrame:
    """Return the table of the folder of ``penode sweep --out``, one row a task.

    The rows are the Parquet file's where the sweep has ended, else the lines so far; refuses a file
    that is not as it was written.
    """
    path, ended = folder / LINES, folder / PARQUET
    try:
        content, written = path.read_bytes(), path.stat().st_mtime_ns
        if not ended.exists() or ended.stat().st_mtime_ns < written:
            return _last_lines(path, content)
        return pl.read_parquet(ended)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(
            f"{path}: no such file; give the folder that `penode sweep --out` wrote."
        ) from error
    except pl.exceptions.PolarsError as error:
        raise InputError(
            f"{ended}: not as it was written ({str(error)[:100]}); start the sweep again."
        ) from error


def _last_lines(path: Path, content: bytes) -> pl.DataFrame:
    """Return the last whole line of each name, columns typed; further parameters come last."""
    lines = content[: content.rfind(b"\n") + 1].splitlines()
    last = {_called(_parsed(line, path, number)): number for number, line in enumerate(lines, 1)}
    frames, chosen = [pl.DataFrame(schema=_TYPES)], sorted(last.values())
    for first in range(0, len(chosen), _BATCH):
        part = chosen[first : first + _BATCH]
        rows = [_parsed(lines[number - 1], path, number) for number in part]
        further = sorted({name for row in rows for name in row} - set(_TYPES))
        frames.append(pl.DataFrame(rows, {**_TYPES, **dict.fromkeys(further, pl.Float64)}))
    whole = pl.concat(frames, how="diagonal")
    return whole.select(*_TYPES, *sorted(set(whole.columns) - set(_TYPES)))


def _parsed(line: bytes, path: Path, number: int) -> dict[str, Any]:
    try:
        row = json.loads(line)
        if not isinstance(row, dict) or not {"key", "status", *LABELS} <= set(row):
            raise ValueError("it is no row")
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: line {number} is not as it was written ({str(error)[:100]}); delete the line."
        ) from error
    return row


def _called(row: Mapping[str, Any]) -> int:
    return hash(tuple(row[name] for name in LABELS))


def _plain(value: Any) -> Any:
    """Return a value of JSON; a number that is not finite is none."""
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
