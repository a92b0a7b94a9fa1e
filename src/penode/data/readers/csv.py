"""Reader of comma-separated text files with one header line.

A fast parse takes every well-formed file. What it cannot take is read again cell by cell, slowly,
to find the row and channel that a refusal has to name.
"""

import csv
import io
import math
from pathlib import Path

import numpy as np
import polars as pl

from penode.arrays import FloatArray
from penode.data.table import Table, cell_error, clean_names
from penode.errors import InputError

_BOOLEANS = {"true": 1.0, "false": 0.0}


def read(path: Path) -> Table:
    """Read the columns of a CSV file.

    Cells are separated by commas. Spaces around names and cells, a byte-order mark, blank lines
    and columns of ``true`` and ``false`` are accepted.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    dict of str to ndarray, each of shape (time,)
        Columns in the order of the file, float64 and finite, in the units of the file.

    Raises
    ------
    InputError
        If the file is empty, not UTF-8 text, has a bad header, or holds a cell that is missing or
        not a finite number; the message names the data row (from 1, header not counted), the
        line of the file and the channel.
    OSError
        If the file cannot be opened.
    """
    file = str(path)
    text = _decode(file, path.read_bytes())
    header = io.StringIO(text, newline="").readline()
    names = _header_names(file, header)
    table = _parse_fast(names, text[len(header) :])
    return table if table is not None else _parse_cells(file, names, text)


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


def _header_names(file: str, header: str) -> list[str]:
    """Split the first line into column names."""
    if not header.strip():
        raise InputError(f"{file}: line 1 is blank; make the line of column names the first one.")
    try:
        cells = next(csv.reader([header.strip()]))
    except csv.Error as error:
        raise _unsplittable(file, 1, error) from error
    if len(cells) == 1 and any(mark in cells[0] for mark in ";\t|"):
        raise InputError(
            f"{file}: the header {cells[0][:60]!r} is not separated by commas; "
            "export the file with commas between columns and points in numbers."
        )
    if all(_number(cell) is not None for cell in cells):
        raise InputError(
            f"{file}: line 1 holds numbers where column names were wanted; add a header line."
        )
    return clean_names(file, cells)


def _parse_fast(names: list[str], body: str) -> Table | None:
    """Parse the data rows in one go; None if anything at all is out of the ordinary."""
    schema = dict.fromkeys(names, pl.Float64())
    try:
        frame = pl.read_csv(body.encode(), has_header=False, schema=schema)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException):
        return None
    table = {name: frame[name].to_numpy() for name in names}  # a missing cell becomes NaN
    finite = all(np.isfinite(values).all() for values in table.values())
    return table if finite else None


def _parse_cells(file: str, names: list[str], text: str) -> Table:
    """Parse cell by cell, naming the first cell that is not a finite number."""
    reader = csv.reader(io.StringIO(text, newline=""))
    rows: list[list[str]] = []
    places: list[str] = []
    try:
        next(reader)
        for cells in reader:
            if not "".join(cells).strip() and len(cells) <= 1:
                continue  # a blank line
            places.append(f"data row {len(rows) + 1} (line {reader.line_num})")
            rows.append(cells)
            if len(cells) != len(names):
                raise InputError(
                    f"{file}: {places[-1]} has {len(cells)} cells where the header names "
                    f"{len(names)} columns; write one cell for each column."
                )
    except csv.Error as error:
        raise _unsplittable(file, reader.line_num, error) from error
    return {
        name: _column(file, name, [cells[index] for cells in rows], places)
        for index, name in enumerate(names)
    }


def _unsplittable(file: str, line: int, error: csv.Error) -> InputError:
    """Make the refusal of a line that cannot be split into cells."""
    return InputError(
        f"{file}: line {line} cannot be split into cells ({error}); "
        "look for an unclosed quotation mark."
    )


def _column(file: str, name: str, cells: list[str], places: list[str]) -> FloatArray:
    """Convert one column, truth values becoming 1 and 0 where the column holds nothing else."""
    words = [cell.strip().lower() for cell in cells]
    if cells and all(word in _BOOLEANS for word in words):
        return np.array([_BOOLEANS[word] for word in words])
    values = np.empty(len(cells))
    for index, cell in enumerate(cells):
        number = _number(cell)
        if number is None or not math.isfinite(number):
            raise cell_error(file, places[index], name, cell)
        values[index] = number
    return values


def _number(cell: str) -> float | None:
    """Return the number a cell holds, None if it holds none."""
    try:
        # Python reads 1_000 as a number; no other program that writes CSV does.
        return None if "_" in cell else float(cell)
    except ValueError:
        return None
