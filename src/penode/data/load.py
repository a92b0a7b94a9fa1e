"""Load a recording from a file into an Experiment."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from penode.data.content import Content
from penode.data.experiment import Experiment, Source
from penode.data.isolation import isolated
from penode.data.mapping import Origin, map_channels, own_names
from penode.data.readers import csv
from penode.data.stretches import SHORTEST, between_gaps
from penode.data.table import TIME, Table, list_names
from penode.errors import InputError, require_extra


def _csv(content: Content) -> Table:
    if content.file.lower().endswith(".gz"):
        return csv.read_packed(content.file, content.all())
    return csv.read(content.file, content.mapped())


def _parquet(content: Content) -> Table:
    require_extra("polars", "tables", f"{content.file}: a Parquet file")
    return isolated("parquet")(content)


def _xlsx(content: Content) -> Table:
    require_extra("openpyxl", "excel", f"{content.file}: an Excel workbook")
    return isolated("xlsx")(content)


#: Reader of each file suffix, from the content to the columns; binary files are decoded apart.
READERS: Mapping[str, Callable[[Content], Table]] = MappingProxyType(
    {
        ".csv": _csv,
        ".parquet": _parquet,
        ".mat": isolated("mat"),
        ".mf4": isolated("mdf"),
        ".tdms": isolated("tdms"),
        ".csv.gz": _csv,
        ".txt": _csv,
        ".tsv": _csv,
        ".xlsx": _xlsx,
    }
)


def load(
    path: str | os.PathLike[str],
    name: str | None = None,
    columns: Mapping[str, str] | None = None,
) -> Experiment:
    """Load a recording; the suffix of the file chooses the reader.

    Column ``t`` gives the time step, every other column becomes a channel. A unit that the file
    gives and `penode.data.units` knows is converted to SI; all other values are left as they are.
    Nothing is repaired: what is missing, not finite or not uniform is refused.

    Parameters
    ----------
    path : str or path-like
        A ``.csv``, ``.csv.gz``, ``.parquet``, ``.mat``, ``.mf4`` or ``.tdms`` file, or an
        ``.xlsx`` workbook whose first sheet is the table.
    name : str, optional
        Label of the experiment in messages and reports; the file's name if not given.
    columns : mapping of str to str, optional
        Channel -> column of the file, ``t`` among them where the time has another name. Columns
        that are not named are left out; without it, all are channels of their own names.

    Returns
    -------
    Experiment
        Channels of shape (time,) in float64, the time step in s, and the file's path and SHA-256.

    Raises
    ------
    InputError
        If the file is not found, is of an unknown kind, damaged or empty, lacks a column that is
        named, has no column ``t`` or no other one, holds a cell that is not a finite number, has
        fewer than 8 samples, is not sampled uniformly within 1 %, or has channels of different
        sampling times.
    """
    if columns is None:
        experiment = in_one_piece(load_stretches(path))
    else:
        origins = {channel: Origin(column) for channel, column in columns.items()}
        if TIME in origins:
            origins[TIME] = Origin(columns[TIME], "s")
        experiment = in_one_piece(experiments_of(*read(path), origins))
    return experiment if name is None else replace(experiment, name=name)


def load_stretches(path: str | os.PathLike[str]) -> tuple[Experiment, ...]:
    """Load a recording that may have gaps in time, as the stretches between them.

    Nothing that works on experiments crosses from one into another. Their `Experiment.stretch`
    says where in the recording they lie, and what was left out. Where there is no gap, the one
    stretch is the recording as `load` gives it.

    Parameters
    ----------
    path : str or path-like
        As in `load`.

    Returns
    -------
    tuple of Experiment
        In order of time.

    Raises
    ------
    InputError
        As in `load`, but of gaps only where what lies between is shorter than 200 samples for the
        most part.
    """
    table, source = read(path)
    return experiments_of(table, source, own_names(table))


def in_one_piece(stretches: Sequence[Experiment]) -> Experiment:
    """Return the recording that `load_stretches` gave, refusing one with gaps."""
    if len(stretches) == 1 and stretches[0].stretch is None:
        return stretches[0]
    file, reasons = stretches[0].source.path, " ".join(stretches[0].place.reasons)
    raise InputError(f"{file}: {reasons} Take its stretches with load_stretches, or cut the file.")


def read(path: str | os.PathLike[str]) -> tuple[Table, Source]:
    """Read the columns of a file as they are; binary files are decoded in a process of their own.

    Returns a table of columns in the units of the file, and the file's path with the SHA-256 of the
    bytes that were decoded. Refused is a file that is not found, no regular file, of an unknown
    kind, damaged or empty, changes while it is read, takes far more memory or time than files of
    its size, or needs a library that is not installed.
    """
    file = str(path)
    try:
        reader = _reader_for(Path(path), file)
        with Content(file) as content:
            table = reader(content)
            return table, Source(path=file, sha256=content.sha256)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{file}: the file cannot be read ({reason}); check it.") from error


def experiments_of(
    table: Table,
    source: Source,
    origins: Mapping[str, Origin],
    resample: bool = False,
    time_step: float | None = None,
) -> tuple[Experiment, ...]:
    """Make a recording of the columns of a file, or the stretches between its gaps.

    ``table`` and ``source`` are as `read` gives them, the rest as `map_channels` takes it; named
    after the file. Refuses a file without time, channel or data row.
    """
    file = source.path
    time = origins.get(TIME, Origin(TIME, "s")).column
    channels = [origin.column for name, origin in origins.items() if name != TIME]
    for column in (time, *channels):
        table.require_numbers(file, column)
    if time not in table.columns and not all(column in table.clocks for column in channels):
        how = (
            f"rename the time column to {time}, or say which it is: columns={{'{time}': ...}} in "
            "penode.load, or for a drive a study file (penode init begins one)"
        )
        if TIME in origins:
            how = (
                f"the study file maps {TIME} to it: name the column of this recording there, or in "
                "a study file of its own beside it (--config twice)"
            )
        raise InputError(
            f"{file}: no column {time} (time in s); the columns are {list_names(table.columns)}; "
            f"{how}."
        )
    if not channels:
        raise InputError(f"{file}: no column besides {time}; add the measured channels.")
    used = [column for column in channels if column in table.columns]
    empty = [column for column in used if not len(table.columns[column])]
    if empty and empty == used:
        raise InputError(f"{file}: a header but no data rows; record or export the data again.")
    if empty:
        raise InputError(
            f"{file}: column {empty[0]} has no values where another has some; record or export the "
            "data again, or remove it."
        )
    mapped = map_channels(file, table, origins, resample, time_step)
    whole = Experiment(Path(file).name, mapped.time_step, mapped.channels, source)
    return between_gaps(whole, mapped.times - mapped.times[0], mapped.spans, SHORTEST)


def _reader_for(location: Path, file: str) -> Callable[[Content], Table]:
    """Choose the reader by suffix, refusing what is not a file."""
    if location.is_symlink() and not location.exists():
        raise InputError(f"{file}: a link to what is not there; correct the link.")
    if not location.exists():
        raise InputError(f"{file}: file not found; check the path.")
    kinds = " or ".join(READERS)
    if location.is_dir():
        what = "the folder of a result" if (location / "result.json").exists() else "a directory"
        raise InputError(
            f"{file}: this is {what} where a recording was wanted; name one {kinds} file."
        )
    suffixes = [suffix.lower() for suffix in location.suffixes[-2:]]
    reader = READERS.get("".join(suffixes)) or READERS.get("".join(suffixes[-1:]))
    if reader is None:
        got = f"suffix {location.suffix!r}" if location.suffix else "no suffix"
        raise InputError(f"{file}: the file must end in {kinds}, got {got}.")
    return reader
