"""Reader of flux maps in CSV files: one header line, one row a point."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError

_MISSING = ("", "nan", "NaN", "NA")


def read(path: Path) -> dict[str, FloatArray]:
    """Read the numeric columns of a CSV file.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    dict of str to ndarray, each of shape (row,)
        Columns by name; empty cells are NaN, columns of text are left out.

    Raises
    ------
    InputError
        If the file is no table with a header line, or holds no numeric column.
    OSError
        If the file cannot be opened.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header, *rows = [row for row in csv.reader(file) if row]
        cells = dict(zip(header, zip(*rows, strict=True), strict=True))
    except (ValueError, csv.Error) as error:
        raise InputError(
            f"{path}: not a table of comma-separated values ({error}); write one header line and "
            "as many cells in each row."
        ) from error
    columns = {name.strip(): _numbers(column) for name, column in cells.items()}
    numeric = {name: values for name, values in columns.items() if values is not None}
    if not numeric:
        raise InputError(f"{path}: no column holds numbers only; a flux map in SI was wanted.")
    return numeric


def _numbers(cells: Sequence[str]) -> FloatArray | None:
    """Return cells as numbers, None where one is text."""
    try:
        return np.array([np.nan if cell.strip() in _MISSING else float(cell) for cell in cells])
    except ValueError:
        return None
