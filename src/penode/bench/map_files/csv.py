"""Reader of flux maps in CSV files: one header line, one row a point."""

from pathlib import Path

import numpy as np
import polars as pl

from penode.arrays import FloatArray
from penode.errors import InputError


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
    text = path.read_bytes()
    try:
        frame = pl.read_csv(text, infer_schema_length=None, null_values=["", "nan", "NaN", "NA"])
    except pl.exceptions.PolarsError as error:
        reason = str(error).splitlines()[0] if str(error) else "empty"
        raise InputError(
            f"{path}: not a table of comma-separated values ({reason}); write one header line and "
            "as many cells in each row."
        ) from error
    numeric = [name for name in frame.columns if frame[name].dtype.is_numeric()]
    if not numeric:
        raise InputError(f"{path}: no column holds numbers only; a flux map in SI was wanted.")
    return {
        name.strip(): np.asarray(frame[name].cast(pl.Float64).to_numpy(), dtype=np.float64)
        for name in numeric
    }
