"""Write a recording to a file that `penode.data.load` reads back."""

import csv
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError, require_extra


def _write_csv(columns: Mapping[str, FloatArray], path: Path) -> None:
    """Write floats so that they are read back to the last digit."""
    rows = zip(*(map(repr, values.tolist()) for values in columns.values()), strict=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def _write_parquet(columns: Mapping[str, FloatArray], path: Path) -> None:
    import polars as pl

    pl.DataFrame(dict(columns)).write_parquet(path)


_WRITERS = {".csv": _write_csv, ".parquet": _write_parquet}


def require_suffix(path: Path) -> Callable[[Mapping[str, FloatArray], Path], None]:
    """Return the writer for a path, or refuse its suffix with an `InputError`."""
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(f"{path}: suffix {path.suffix!r} came; use {' or '.join(_WRITERS)}.")
    if writer is _write_parquet:
        require_extra("polars", "tables", f"{path}: a Parquet file")
    return writer


def save(experiment: Experiment, path: str | Path) -> None:
    """Write time and channels as columns, CSV or Parquet by suffix.

    Parameters
    ----------
    experiment : Experiment
        Its time column t starts at zero.
    path : str or Path
        Replaced in one step.

    Raises
    ------
    InputError
        If the suffix is neither .csv nor .parquet.
    """
    path = Path(path)
    writer = require_suffix(path)
    time = np.arange(len(experiment), dtype=np.float64) * experiment.time_step
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        writer({"t": time, **experiment.channels}, partial)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
