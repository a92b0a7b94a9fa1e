"""Write a recording to a file that `penode.data.load` reads back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

from penode.data.experiment import Experiment
from penode.errors import InputError

_WRITERS: dict[str, Callable[..., object]] = {
    ".csv": pl.DataFrame.write_csv,
    ".parquet": pl.DataFrame.write_parquet,
}


def require_suffix(path: Path) -> Callable[..., object]:
    """Return the writer for a path, refusing another suffix."""
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
