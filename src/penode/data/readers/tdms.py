"""Reader of TDMS measurement files, by the library npTDMS."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.data.signals import Signal, table_of
from penode.data.table import Table
from penode.errors import InputError

# Where programs write the unit of a channel.
_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "unit")


def read(path: Path) -> Table:
    """Read the numeric channels of a TDMS file.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    Table
        Channels as float64, in the units of the file. A waveform has its own times for a clock,
        another channel the time column of its group; see `penode.data.signals.table_of`.

    Raises
    ------
    InputError
        If npTDMS is not installed, or the file is no TDMS file or damaged.
    OSError
        If the file cannot be opened.
    """
    file = str(path)
    with path.open("rb") as opened:
        if opened.read(4) != b"TDSm":
            raise InputError(f"{file}: the content is no TDMS file; export the recording as TDMS.")
    try:
        library = importlib.import_module("nptdms")
    except ImportError as error:
        raise InputError(
            f"{file}: reading TDMS needs the library npTDMS; pip install 'penode[tdms]'."
        ) from error
    try:
        signals = _signals(library.TdmsFile.read(path))
    except Exception as error:  # the library has no base class for what a damaged file raises
        raise InputError(
            f"{file}: the TDMS file is damaged ({type(error).__name__}); export it again."
        ) from error
    return table_of(file, signals)


def _signals(content: Any) -> list[Signal]:
    """Return the numeric channels of all groups."""
    channels = [channel for group in content.groups() for channel in group.channels()]
    begins = [c.properties["wf_start_time"] for c in channels if "wf_start_time" in c.properties]
    return [
        Signal(
            channel.group_name,
            channel.name,
            _unit(channel),
            np.asarray(channel[:], dtype=np.float64),
            _times(channel, min(begins, default=None)),
        )
        for channel in channels
        if channel.dtype is not None and channel.dtype.kind in "biuf"
    ]


def _unit(channel: Any) -> str:
    units = (channel.properties[name] for name in _UNIT_PROPERTIES if name in channel.properties)
    return str(next(units, ""))


def _times(channel: Any, begin: Any) -> FloatArray | None:
    """Return the times of a waveform in s, counted from the begin of the first one."""
    properties = channel.properties
    increment = float(properties.get("wf_increment", 0.0))
    if increment <= 0.0:
        return None
    start = float(properties.get("wf_start_offset", 0.0))
    if "wf_start_time" in properties:
        start += float((properties["wf_start_time"] - begin) / np.timedelta64(1, "s"))
    return np.asarray(start + increment * np.arange(len(channel)), dtype=np.float64)
