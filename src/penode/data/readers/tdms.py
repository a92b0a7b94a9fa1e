"""Reader of TDMS measurement files, by the library npTDMS."""

import importlib
import io
from functools import partial
from typing import Any, BinaryIO, Literal

import numpy as np

from penode.data.table import Column, Signal, Table, table_of
from penode.errors import InputError, printable

# A segment begins with a tag, a mask, a version, and the lengths of all of it and of its header.
_TAG = b"TDSm"
_LEAD_IN = 28
_BIG_ENDIAN = 1 << 6
# Where programs write the unit of a channel.
_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "unit")


def read(file: str, source: BinaryIO) -> Table:
    """Read the numeric channels of a TDMS file, float64, in the units of the file.

    A waveform has its own times for a clock, another channel the time column of its group
    (`penode.data.table.table_of`). A damaged file makes the library raise what it will.
    """
    size = source.seek(0, io.SEEK_END)
    source.seek(0)
    if source.read(len(_TAG)) != _TAG:
        raise InputError(f"{file}: the content is no TDMS file; export the recording as TDMS.")
    try:
        library = importlib.import_module("nptdms")
    except ImportError as error:
        raise InputError(
            f"{file}: reading TDMS needs the library npTDMS; pip install 'penode[tdms]'."
        ) from error
    if not _is_complete(source, size):
        raise InputError(f"{file}: the TDMS file is cut short; copy or export it again.")
    source.seek(0)
    recording = library.TdmsFile.open(source)
    table = table_of(file, _signals(recording))
    names = (channel.name for channel in _channels(recording) if not _is_numeric(channel))
    table.left_out.update({printable(name): "text or without data" for name in names})
    return table


def _is_complete(source: BinaryIO, size: int) -> bool:
    """Return whether the last segment ends where the file does; the library reads what is left."""
    end = 0
    while end < size:
        source.seek(end)
        head = source.read(_LEAD_IN)
        if len(head) < _LEAD_IN or not head.startswith(_TAG):
            return False
        order: Literal["big", "little"] = "big" if head[4] & _BIG_ENDIAN else "little"
        end += _LEAD_IN + int.from_bytes(head[12:20], order)
    return end == size


def _signals(recording: Any) -> list[Signal]:
    """Return the numeric channels of all groups."""
    channels = _channels(recording)
    begins = [c.properties["wf_start_time"] for c in channels if "wf_start_time" in c.properties]
    return [
        Signal(
            channel.group_name,
            channel.name,
            _unit(channel),
            partial(_values, channel),
            _times(channel, min(begins, default=None)),
        )
        for channel in channels
        if _is_numeric(channel)
    ]


def _channels(recording: Any) -> list[Any]:
    return [channel for group in recording.groups() for channel in group.channels()]


def _is_numeric(channel: Any) -> bool:
    return channel.dtype is not None and channel.dtype.kind in "biuf"


def _values(channel: Any) -> Column:
    return np.asarray(channel[:], dtype=np.float64)


def _unit(channel: Any) -> str:
    units = (channel.properties[name] for name in _UNIT_PROPERTIES if name in channel.properties)
    return str(next(units, ""))


def _times(channel: Any, begin: Any) -> Column | None:
    """Return the times of a waveform in s, counted from the begin of the first one."""
    properties = channel.properties
    increment = float(properties.get("wf_increment", 0.0))
    if increment <= 0.0:
        return None
    start = float(properties.get("wf_start_offset", 0.0))
    if "wf_start_time" in properties:
        start += float((properties["wf_start_time"] - begin) / np.timedelta64(1, "s"))
    return np.asarray(start + increment * np.arange(len(channel)), dtype=np.float64)
