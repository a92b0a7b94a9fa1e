"""Reader of parquet files with flat numeric columns."""

import io
from collections.abc import Callable
from functools import partial
from typing import BinaryIO

import numpy as np
import polars as pl

from penode.data.table import Column, Decoded, Table, cell_error, clean_names
from penode.errors import InputError

_MAGIC = b"PAR1"
# Rows that one byte of all columns together can be unpacked to.
_COMPRESSION = 1040


def read(file: str, source: BinaryIO) -> Table:
    """Read the numeric columns of a parquet file, in order and units of the file, when asked for.

    They are float64 and finite; text and dates are left out.
    """
    _require_plausible(file, source)
    head = _of_polars(file, source, partial(pl.read_parquet, n_rows=1))
    names = clean_names(file, head.columns)
    series = dict(zip(names, head.get_columns(), strict=True))
    text = {name: ("data row 1", str(s[0])) for name, s in series.items() if len(s) and _is_text(s)}
    numbers = {name: s.name for name, s in series.items() if name not in text}

    def column(name: str) -> Column:
        decode = partial(pl.read_parquet, columns=[numbers[name]])
        return _column(file, name, _of_polars(file, source, decode).to_series())

    return Table(Decoded({name: partial(column, name) for name in numbers}), text=text)


def _require_plausible(file: str, source: BinaryIO) -> None:
    """Refuse more rows than the bytes of the file can hold, before any is decoded."""
    size = source.seek(0, io.SEEK_END)
    count = _of_polars(
        file, source, lambda opened: pl.scan_parquet(opened).select(pl.len()).collect()
    )
    rows = int(count.item())
    if rows > _COMPRESSION * size:
        raise InputError(
            f"{file}: {rows} rows are declared in a file of {size} bytes, so it is damaged; copy "
            "or export it again."
        )


def _is_text(series: pl.Series) -> bool:
    """Return whether a column holds words or times of day."""
    return series.dtype in (pl.String, pl.Categorical) or series.dtype.is_temporal()


def _of_polars(
    file: str, source: BinaryIO, ask: Callable[[BinaryIO], pl.DataFrame]
) -> pl.DataFrame:
    """Ask for something of the file, refusing it where it is no parquet file."""
    source.seek(0)
    head = source.read(len(_MAGIC))
    source.seek(0)
    if not head:
        raise InputError(f"{file}: the file is empty; record or export it again.")
    if head != _MAGIC:
        raise InputError(
            f"{file}: the content is not parquet; rename a text file to end in .csv, "
            "or export the recording again."
        )
    try:
        return ask(source)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(
            f"{file}: the parquet file is damaged or incomplete ({reason}); "
            "copy or export it again."
        ) from error


def _column(file: str, name: str, series: pl.Series) -> Column:
    """Convert one column to float64, refusing what is not a finite number."""
    if series.null_count():
        row = int(series.is_null().arg_true()[0]) + 1
        raise cell_error(file, f"data row {row}", name, None)
    if not (series.dtype.is_numeric() or series.dtype == pl.Boolean):
        raise InputError(
            f"{file}: channel {name} holds {series.dtype} values where numbers were wanted; "
            "convert it to float64 in SI units or remove the column."
        )
    values = series.cast(pl.Float64).to_numpy()
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise cell_error(file, f"data row {bad[0] + 1}", name, str(values[bad[0]]))
    return values
