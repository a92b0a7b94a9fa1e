"""Write a recording to a file that `penode.data.load` reads back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

from penode.data.experiment import Experiment
from penode.errors import InputError

_WRITERS: dict[str, Callable[[pl.DataFrame, Path], object]] = {
    ".csv": lambda table, path: table.write_csv(path),
    ".parquet": lambda table, path: table.write_parquet(path),
}


def require_suffix(path: Path) -> Callable[[pl.DataFrame, Path], object]:
    """Return the writer for a path, or refuse its suffix with an `InputError`."""
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(f"{path}: suffix {path.suffix!r} came; use {' or '.join(_WRITERS)}.")
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
    time = np.arange(len(experiment)) * experiment.time_step
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        writer(pl.DataFrame({"t": time, **experiment.channels}), partial)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
