"""Load a recording from a file into an Experiment."""

import hashlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from penode.data.experiment import Experiment, Source
from penode.data.readers import csv, parquet
from penode.data.table import Table, list_names
from penode.data.time_axis import uniform_step
from penode.errors import InputError

#: Reader of each file suffix. A reader takes a path and returns the file's columns.
READERS: Mapping[str, Callable[[Path], Table]] = MappingProxyType(
    {".csv": csv.read, ".parquet": parquet.read}
)

#: Column that holds the time in s.
TIME = "t"


def load(path: str | os.PathLike[str], name: str | None = None) -> Experiment:
    """Load a recording; the suffix of the file chooses the reader.

    Column ``t`` (s) gives the time step, every other column becomes a channel in the units of the
    file. Nothing is repaired: what is missing, not finite or not uniform is refused.

    Parameters
    ----------
    path : str or path-like
        A ``.csv`` or ``.parquet`` file.
    name : str, optional
        Label of the experiment in messages and reports; the file's name if not given.

    Returns
    -------
    Experiment
        Channels of shape (time,) in float64, the time step in s, and the file's path and SHA-256.

    Raises
    ------
    InputError
        If the file is not found, is of an unknown kind, damaged or empty, has no column ``t`` or
        no other one, holds a cell that is not a finite number, has fewer than 8 samples, or is
        not sampled uniformly within 1 %.
    """
    file = str(path)
    location = Path(path)
    reader = _reader_for(location, file)
    try:
        table = reader(location)
        digest = hashlib.sha256(location.read_bytes()).hexdigest()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{file}: the file cannot be read ({reason}); check it.") from error
    time_step = _take_time_step(file, table)
    return Experiment(
        name=location.name if name is None else name,
        time_step=time_step,
        channels=table,
        source=Source(path=file, sha256=digest),
    )


def _reader_for(location: Path, file: str) -> Callable[[Path], Table]:
    """Choose the reader by suffix, refusing what is not a file."""
    wanted = " or ".join(READERS)
    if not location.exists():
        raise InputError(f"{file}: file not found; check the path.")
    if location.is_dir():
        raise InputError(f"{file}: this is a directory; name one {wanted} file.")
    reader = READERS.get(location.suffix.lower())
    if reader is None:
        came = f"suffix {location.suffix!r}" if location.suffix else "no suffix"
        raise InputError(f"{file}: {came} where {wanted} was wanted; export it as one of these.")
    return reader


def _take_time_step(file: str, table: Table) -> float:
    """Take the time column out of the table and return its step in s."""
    if TIME not in table:
        raise InputError(
            f"{file}: no column {TIME} (time in s); the columns are {list_names(table)}; "
            f"rename the time column to {TIME}."
        )
    t = table.pop(TIME)
    if not table:
        raise InputError(f"{file}: no column besides {TIME}; add the measured channels.")
    if not len(t):
        raise InputError(f"{file}: a header but no data rows; record or export the data again.")
    return uniform_step(file, t)
