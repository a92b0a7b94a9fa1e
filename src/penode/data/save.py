"""Write a recording to a file that `penode.data.load` reads back."""

import csv
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError, require_extra

Columns = Mapping[str, FloatArray]


def _csv(columns: Columns, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


def _parquet(columns: Columns, path: Path) -> None:
    require_extra("polars", "tables", f"{path}: a Parquet file")
    import polars as pl

    pl.DataFrame(dict(columns)).write_parquet(path)


_WRITERS = {".csv": _csv, ".parquet": _parquet}


def require_suffix(path: Path) -> Callable[[Columns, Path], None]:
    """Return what writes columns to a path, refusing another suffix."""
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(
            f"{path}: the suffix must be {' or '.join(_WRITERS)}, got {path.suffix!r}."
        )
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
        If the suffix is neither .csv nor .parquet, or Parquet's library is not installed.
    """
    path = Path(path)
    writer = require_suffix(path)
    time: FloatArray = np.arange(len(experiment), dtype=np.float64) * experiment.time_step
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        writer({"t": time, **experiment.channels}, partial)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
