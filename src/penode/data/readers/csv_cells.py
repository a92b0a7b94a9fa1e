"""Cells of text files: numbers as they are written, and rows parsed one cell at a time."""

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from penode.data.gathered import Gathered
from penode.data.table import Column, cell_error
from penode.errors import InputError

_BOOLEANS = {"true": 1.0, "false": 0.0}


@dataclass(frozen=True)
class Dialect:
    """How the cells of a file are written."""

    separator: str
    decimal_comma: bool

    def split(self, line: str) -> list[str]:
        """Split one line into cells."""
        return next(csv.reader([line.strip(" \r\n")], delimiter=self.separator), [])

    def number(self, cell: str) -> float | None:
        """Return the number a cell holds, None if it holds none."""
        if self.decimal_comma:
            # A point beside decimal commas separates thousands: 1.234 is no number then.
            cell = cell.replace(".", "_").replace(",", ".")
        try:
            # Python reads 1_000 as a number; no other program that writes CSV does.
            return None if "_" in cell else float(cell)
        except ValueError:
            return None


@dataclass
class _Seen:
    """What came in one column so far: finite numbers, others that are no truth value.

    ``first`` is place and text of the first cell that is no finite number.
    """

    number: bool = False
    other: bool = False
    first: tuple[str, str] | None = None


class Cells:
    """The parse of a file's rows, block by block, of which the first has ``lines`` above it."""

    def __init__(self, file: str, names: Sequence[str], dialect: Dialect, lines: int) -> None:
        self._file = file
        self._dialect = dialect
        self._rows = 0
        self._lines = lines
        self._seen = {name: _Seen() for name in names}
        self._parts = {name: Gathered() for name in names}

    @property
    def text(self) -> dict[str, tuple[str, str]]:
        """Columns without a number so far: place and text of the first cell."""
        seen = {n: s.first for n, s in self._seen.items() if s.other and not s.number}
        return {
            name: first for name, first in seen.items() if first is not None and first[1].strip()
        }

    def add(self, block: dict[str, Column], lines: int) -> None:
        """Add a block of so many lines whose cells, but in columns of text, are finite numbers."""
        for name, values in block.items():
            self._parts[name].add(values)
            self._seen[name].number |= len(values) > 0
        self._rows += len(next(iter(block.values())))
        self._lines += lines

    def parse(self, lines: Iterable[str]) -> None:
        """Add a block of rows as text; refuse a row that has not one cell for each column.

        Truth values become 1 and 0; what is wrong with other cells is kept for `columns`, as a row
        of another length is refused first.
        """
        reader = csv.reader(lines, delimiter=self._dialect.separator)
        table: list[list[float]] = [[] for _ in self._seen]
        try:
            for cells in reader:
                if not "".join(cells).strip() and len(cells) <= 1:
                    continue  # a blank line
                self._rows += 1
                place = f"data row {self._rows} (line {self._lines + reader.line_num})"
                if len(cells) != len(table):
                    raise self._other_length(place, len(cells))
                for column, seen, cell in zip(table, self._seen.values(), cells, strict=True):
                    column.append(self._value(seen, cell, place))
        except csv.Error as error:
            raise unsplittable(self._file, self._lines + reader.line_num, error) from error
        self._lines += reader.line_num
        for parts, column in zip(self._parts.values(), table, strict=True):
            parts.add(np.array(column, dtype=np.float64))

    def _other_length(self, place: str, cells: int) -> InputError:
        """Return the refusal of a row that has not one cell for each column."""
        mend = "write one cell for each column"
        if len(self._seen) == 1:
            mend = "remove lines that stand above the column names"
        return InputError(
            f"{self._file}: {place} has {cells} cells where the header names {len(self._seen)} "
            f"columns; {mend}."
        )

    def _value(self, seen: _Seen, cell: str, place: str) -> float:
        number = self._dialect.number(cell)
        if number is not None and math.isfinite(number):
            seen.number = True
            return number
        seen.first = seen.first or (place, cell)
        word = _BOOLEANS.get(cell.strip().lower())
        seen.other |= word is None
        return math.nan if word is None else word

    def columns(self) -> dict[str, Column]:
        """Return the columns, those of text left out; refuse a cell that is not a finite number.

        A column may hold truth values only. The message names the first such cell of the first such
        column.
        """
        text = self.text
        numbers = [name for name in self._seen if name not in text]
        for name in numbers:
            seen = self._seen[name]
            if seen.first is not None and (seen.other or seen.number):
                place, cell = seen.first
                raise cell_error(self._file, place, name, cell)
        return {name: self._parts[name].whole() for name in numbers}


def unsplittable(file: str, line: int, error: csv.Error) -> InputError:
    """Make the refusal of a line, counted from 1, that cannot be split into cells."""
    return InputError(
        f"{file}: line {line} cannot be split into cells ({error}); "
        "look there and above for an unclosed quotation mark."
    )
