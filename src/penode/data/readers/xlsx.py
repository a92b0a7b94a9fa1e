"""Reader of Excel workbooks: the first sheet, as if it had been saved as text."""

from itertools import dropwhile
from typing import Any, BinaryIO

import openpyxl

from penode.data.readers import csv
from penode.data.table import Table
from penode.errors import InputError

_MAGIC = b"PK\x03\x04"


def read(file: str, source: BinaryIO) -> Table:
    """Read the columns of the first sheet as `penode.data.readers.csv.read` reads them.

    Formulas have the values that were saved with them. Lines in refusals are rows of the sheet. A
    damaged file makes the library raise what it will.
    """
    if source.read(len(_MAGIC)) != _MAGIC:
        raise InputError(
            f"{file}: no Excel workbook (.xlsx), or damaged; save it from Excel again, or as CSV."
        )
    book = openpyxl.load_workbook(source, read_only=True, data_only=True)
    if not book.worksheets:
        raise InputError(f"{file}: no sheet of cells in this workbook; put the table in the first.")
    rows = [_filled(row) for row in book.worksheets[0].iter_rows(values_only=True)]
    lines = ("\t".join(map(_text, row)) for row in _of_one_width(rows))
    return csv.read(file, "".join(f"{line}\n" for line in lines).encode())


def _filled(row: tuple[Any, ...]) -> list[Any]:
    """Return the cells of a row without the empty ones at its end."""
    return list(dropwhile(lambda cell: cell is None, reversed(row)))[::-1]


def _of_one_width(rows: list[list[Any]]) -> list[list[Any]]:
    """Return the rows with cells as the header has, which is the first of more than one cell.

    Those above it are titles, which the text reader passes over.
    """
    width = next((len(row) for row in rows if len(row) > 1), 0)
    above = next((k for k, row in enumerate(rows) if len(row) > 1), 0)
    below = [row + [None] * (width - len(row)) if row else [] for row in rows[above:]]
    return rows[:above] + below


def _text(cell: Any) -> str:
    """Return a cell as text: numbers to the last digit, nothing for an empty one."""
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return str(cell).lower()
    return repr(cell) if isinstance(cell, float) else " ".join(str(cell).split())
