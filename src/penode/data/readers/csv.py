"""Reader of text files with one header line: comma-separated values and their relatives.

A fast parse takes every well-formed file. What it cannot take is read again cell by cell, slowly,
to find the row and channel that a refusal has to name.
"""

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from penode.arrays import FloatArray
from penode.data.table import Table, cell_error, clean_names
from penode.data.units import unit_name
from penode.errors import InputError

_BOOLEANS = {"true": 1.0, "false": 0.0}
# Marks that separate cells where every line has them; they are no part of a number.
_RARE_SEPARATORS = "\t;|"


@dataclass(frozen=True)
class _Dialect:
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


def read(path: Path) -> Table:
    """Read the columns of a CSV file.

    Cells are separated by commas, semicolons, tabulators or ``|``; numbers have a decimal point,
    or a comma where that does not separate cells. Below the header may stand a row of units.
    Spaces around names and cells, a byte-order mark, blank lines and columns of ``true`` and
    ``false`` are accepted.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    Table
        Columns in the order of the file, float64 and finite, in the units of the file.

    Raises
    ------
    InputError
        If the file is empty, not UTF-8 text, has a bad header, or holds a cell that is missing or
        not a finite number; the message names the data row (from 1, header and units not
        counted), the line of the file and the channel.
    OSError
        If the file cannot be opened.
    """
    file = str(path)
    text = _decode(file, path.read_bytes())
    lines = io.StringIO(text, newline="")
    header, second = lines.readline(), lines.readline()
    dialect = _dialect(header, second, text[len(header) :])
    names = _header_names(file, header, dialect)
    units = _units(names, second, dialect)
    start = len(header) + (len(second) if units else 0)
    columns = _parse_fast(names, text[start:], dialect)
    if columns is None:
        columns = _parse_cells(file, names, text[start:], dialect, 2 if units else 1)
    return Table(columns, units)


def _decode(file: str, raw: bytes) -> str:
    """Return the text of the file, refusing what is not text."""
    if not raw.strip():
        raise InputError(f"{file}: the file is empty; a header line and data rows were wanted.")
    if raw.startswith(b"PAR1"):
        raise InputError(
            f"{file}: the content is parquet, not CSV text; rename the file to end in .parquet."
        )
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        text, where = "\0", f" (byte {error.start + 1})"
    else:
        where = ""
    if "\0" in text:
        raise InputError(
            f"{file}: the content is binary or not UTF-8 text{where}, where CSV text was wanted; "
            "export it as CSV in UTF-8."
        )
    return text


def _dialect(header: str, second: str, body: str) -> _Dialect:
    """Return how cells are written, from the header, the line below it and all data."""
    lines = [line for line in (header, second) if line.strip()]
    rare = (mark for mark in _RARE_SEPARATORS if all(mark in line for line in lines))
    separator = next(rare, ",")
    return _Dialect(separator, separator != "," and "," in body)


def _header_names(file: str, header: str, dialect: _Dialect) -> list[str]:
    """Split the first line into column names."""
    if not header.strip():
        raise InputError(f"{file}: line 1 is blank; make the line of column names the first one.")
    try:
        cells = dialect.split(header)
    except csv.Error as error:
        raise _unsplittable(file, 1, error) from error
    if all(dialect.number(cell) is not None for cell in cells):
        raise InputError(
            f"{file}: line 1 holds numbers where column names were wanted; add a header line."
        )
    return clean_names(file, cells)


def _units(names: list[str], second: str, dialect: _Dialect) -> dict[str, str]:
    """Return the units in the line below the header, none where it is a row of data.

    A row of units holds at least one that is known, such as V, and no number but 1.
    """
    try:
        cells = dialect.split(second)
    except csv.Error:
        return {}
    units = {unit_name(cell) for cell in cells} - {None, "1"}
    numbers = [cell for cell in cells if dialect.number(cell) is not None and cell.strip() != "1"]
    if len(cells) != len(names) or numbers or not units:
        return {}
    return {name: cell.strip() for name, cell in zip(names, cells, strict=True) if cell.strip()}


def _parse_fast(names: list[str], body: str, dialect: _Dialect) -> dict[str, FloatArray] | None:
    """Parse the data rows in one go; None if anything at all is out of the ordinary."""
    if dialect.decimal_comma and "." in body:
        return None
    schema = dict.fromkeys(names, pl.Float64())
    try:
        frame = pl.read_csv(
            body.encode(),
            has_header=False,
            schema=schema,
            separator=dialect.separator,
            decimal_comma=dialect.decimal_comma,
        )
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException):
        return None
    table = {name: frame[name].to_numpy() for name in names}  # a missing cell becomes NaN
    finite = all(np.isfinite(values).all() for values in table.values())
    return table if finite else None


def _parse_cells(
    file: str, names: list[str], body: str, dialect: _Dialect, lines_before: int
) -> dict[str, FloatArray]:
    """Parse cell by cell, naming the first cell that is not a finite number."""
    reader = csv.reader(io.StringIO(body, newline=""), delimiter=dialect.separator)
    rows: list[list[str]] = []
    places: list[str] = []
    try:
        for cells in reader:
            if not "".join(cells).strip() and len(cells) <= 1:
                continue  # a blank line
            places.append(f"data row {len(rows) + 1} (line {lines_before + reader.line_num})")
            rows.append(cells)
            if len(cells) != len(names):
                raise InputError(
                    f"{file}: {places[-1]} has {len(cells)} cells where the header names "
                    f"{len(names)} columns; write one cell for each column."
                )
    except csv.Error as error:
        raise _unsplittable(file, lines_before + reader.line_num, error) from error
    return {
        name: _column(file, name, [cells[index] for cells in rows], places, dialect)
        for index, name in enumerate(names)
    }


def _unsplittable(file: str, line: int, error: csv.Error) -> InputError:
    """Make the refusal of a line that cannot be split into cells."""
    return InputError(
        f"{file}: line {line} cannot be split into cells ({error}); "
        "look for an unclosed quotation mark."
    )


def _column(
    file: str, name: str, cells: list[str], places: list[str], dialect: _Dialect
) -> FloatArray:
    """Convert one column, truth values becoming 1 and 0 where the column holds nothing else."""
    words = [cell.strip().lower() for cell in cells]
    if cells and all(word in _BOOLEANS for word in words):
        return np.array([_BOOLEANS[word] for word in words])
    values = np.empty(len(cells))
    for index, cell in enumerate(cells):
        number = dialect.number(cell)
        if number is None or not math.isfinite(number):
            raise cell_error(file, places[index], name, cell)
        values[index] = number
    return values
