"""Reader of MDF measurement files (ASAM MDF version 4), by the library asammdf."""

import importlib
import sys
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from penode.data.table import Column, Signal, Table, table_of
from penode.errors import InputError, printable

# Types of conversion (ASAM MDF 4, block CC) that make numbers of numbers: none, linear, rational,
# table with and without interpolation, table of ranges. Those from `_TEXT` on make text.
_NUMERIC = (0, 1, 2, 4, 5, 6)
_ALGEBRAIC = 3
_TEXT = 7
# Type of synchronisation of a master channel (block CN) that counts in s.
_TIME = 1


def read(file: str, source: BinaryIO) -> Table:
    """Read the numeric one-dimensional channels of a closed MDF 4 file, float64, in physical units.

    The times of each channel group are its clock (`penode.data.table.table_of`). A sample that
    the file calls invalid is left out together with its time, which leaves a gap. A formula to
    compute a channel by is refused; a damaged file makes the library raise what it will.
    """
    _check_kind(file, source.read(16))
    source.seek(0)
    sys.modules.setdefault("sympy", None)  # type: ignore[arg-type]  # it executes formulas
    try:
        library = importlib.import_module("asammdf")
    except ImportError as error:
        raise InputError(
            f"{file}: reading MDF needs the library asammdf; pip install 'penode[mdf]'."
        ) from error
    recording = library.MDF(source, process_bus_logging=False)
    table = table_of(file, _signals(file, recording))
    channels = (channel for group in recording.groups for channel in group.channels)
    names = (channel.name for channel in channels if not _is_numeric(file, channel))
    table.left_out.update({printable(name): "text" for name in names})
    return table


def _check_kind(file: str, head: bytes) -> None:
    """Refuse what is no finished MDF file of version 4."""
    if head.startswith(b"UnFinMF"):
        raise InputError(
            f"{file}: the MDF file was not closed by what recorded it; let the recorder or its "
            "tools finalise it."
        )
    if not head.startswith(b"MDF"):
        raise InputError(f"{file}: the content is no MDF file; export the recording as MDF 4.")
    version = head[8:16].decode("ascii", "replace").strip("\0 ")
    if not version.startswith("4."):
        raise InputError(
            f"{file}: the version of MDF must be 4, got {version!r}; export it as MDF 4."
        )


def _signals(file: str, recording: Any) -> list[Signal]:
    """Return the numeric channels of all groups, without the times themselves."""
    signals = []
    for number, group in enumerate(recording.groups):
        numeric = [i for i, channel in enumerate(group.channels) if _is_numeric(file, channel)]
        if not numeric:
            continue
        shared, master = _times(file, recording, number), _time_channel(recording, number)
        for index in numeric:
            head = recording.get(group=number, index=index, record_count=1)
            if index == master or head.samples.ndim != 1 or head.samples.dtype.kind not in "biuf":
                continue
            decode, times = partial(_values, recording, number, index), shared
            if group.channel_group.invalidation_bytes_nr:
                signal = recording.get(group=number, index=index)
                decode = partial(np.asarray, signal.samples.astype(np.float64))
                times = signal.timestamps.astype(np.float64)
            place, clock = f"group {number + 1}", None if master is None else times
            signals.append(Signal(place, head.name, head.unit or "", decode, clock))
    return signals


def _values(recording: Any, number: int, index: int) -> Column:
    """Return the values of a channel of which no sample is invalid."""
    samples, _ = recording.get(group=number, index=index, samples_only=True)
    return np.asarray(samples, dtype=np.float64)


def _times(file: str, recording: Any, number: int) -> Column:
    """Return the times of a group, refusing one that holds other samples than it declares."""
    declared = recording.groups[number].channel_group.cycles_nr
    times = np.asarray(recording.get_master(number), dtype=np.float64)
    if len(times) != declared:
        raise InputError(
            f"{file}: group {number + 1} declares {declared} samples and holds {len(times)}; copy "
            "or export it again."
        )
    return times


def _time_channel(recording: Any, number: int) -> int | None:
    """Return the channel of a group's times; None where its samples are counted otherwise."""
    remote = recording.groups[number].channel_group.cg_master_index
    group = number if remote is None else remote
    master = recording.masters_db.get(group)
    if master is None or recording.groups[group].channels[master].sync_type != _TIME:
        return None
    return int(master) if remote is None else -1


def _is_numeric(file: str, channel: Any) -> bool:
    """Return whether the conversion of a channel gives numbers, refusing a formula."""
    conversion = channel.conversion
    kind = 0 if conversion is None else int(conversion.conversion_type)
    if kind == _ALGEBRAIC:
        formula = str(conversion.formula)[:40]
        raise InputError(
            f"{file}: channel {channel.name} is computed by the formula {formula!r}, which penode "
            "does not execute; export it in physical values, or with a linear conversion."
        )
    if kind not in _NUMERIC and kind < _TEXT:
        raise ValueError("unknown conversion")
    return kind in _NUMERIC
