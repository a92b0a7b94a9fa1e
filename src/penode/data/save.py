"""Write a recording to a file that `penode.data.load` reads back."""

from pathlib import Path

import numpy as np

from penode.data.experiment import Experiment
from penode.errors import InputError

#: Method of a data frame that writes a file, by suffix.
_WRITERS = {".csv": "write_csv", ".parquet": "write_parquet"}


def require_suffix(path: Path) -> str:
    """Return the name of the method that writes a path, refusing another suffix."""
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
    import polars as pl  # takes a fifth of a second to load

    path = Path(path)
    writer = require_suffix(path)
    time = np.arange(len(experiment)) * experiment.time_step
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        getattr(pl.DataFrame({"t": time, **experiment.channels}), writer)(partial)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
