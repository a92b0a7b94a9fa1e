"""Reader of MDF measurement files (ASAM MDF version 4), by the library asammdf."""

import importlib
import io
import sys
from typing import Any

import numpy as np

from penode.data.signals import Signal, table_of
from penode.data.table import Table
from penode.errors import InputError

# Types of conversion (ASAM MDF 4, block CC) that make numbers of numbers: none, linear, rational,
# table with and without interpolation, table of ranges. Those from `_TEXT` on make text.
_NUMERIC = (0, 1, 2, 4, 5, 6)
_ALGEBRAIC = 3
_TEXT = 7
# Type of synchronisation of a master channel (block CN) that counts in s.
_TIME = 1


def read(file: str, content: bytes) -> Table:
    """Read the numeric channels of an MDF file.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    content : bytes

    Returns
    -------
    Table
        Channels of one axis as float64, in physical units as the file's conversions give them.
        The times of each channel group are its clock; see `penode.data.signals.table_of`. A
        sample that the file calls invalid is left out together with its time, which leaves a gap.

    Raises
    ------
    InputError
        If asammdf is not installed, the file is no MDF file of version 4, or not closed, holds
        less than it declares, or a formula to compute a channel by. A damaged file makes the
        library raise what it will.
    """
    _check_kind(file, content)
    sys.modules.setdefault("sympy", None)  # type: ignore[arg-type]  # it executes formulas
    try:
        library = importlib.import_module("asammdf")
    except ImportError as error:
        raise InputError(
            f"{file}: reading MDF needs the library asammdf; pip install 'penode[mdf]'."
        ) from error
    with library.MDF(io.BytesIO(content), process_bus_logging=False) as recording:
        return table_of(file, _signals(file, recording))


def _check_kind(file: str, content: bytes) -> None:
    """Refuse what is no finished MDF file of version 4."""
    if content.startswith(b"UnFinMF"):
        raise InputError(
            f"{file}: the MDF file was not closed by what recorded it; let the recorder or its "
            "tools finalise it."
        )
    if not content.startswith(b"MDF"):
        raise InputError(f"{file}: the content is no MDF file; export the recording as MDF 4.")
    version = content[8:16].decode("ascii", "replace").strip("\0 ")
    if not version.startswith("4."):
        raise InputError(f"{file}: version {version!r} of MDF came; export the recording as MDF 4.")


def _signals(file: str, recording: Any) -> list[Signal]:
    """Return the numeric channels of all groups, without the times themselves."""
    signals = []
    for number, group in enumerate(recording.groups):
        numeric = [i for i, channel in enumerate(group.channels) if _is_numeric(file, channel)]
        if numeric:
            _check_length(file, recording, number)
        master = _time_channel(recording, number)
        for index in numeric:
            signal = recording.get(group=number, index=index)
            if index != master and signal.samples.ndim == 1 and signal.samples.dtype.kind in "biuf":
                values, times = (a.astype(np.float64) for a in (signal.samples, signal.timestamps))
                place, clock = f"group {number + 1}", None if master is None else times
                signals.append(Signal(place, signal.name, signal.unit or "", values, clock))
    return signals


def _check_length(file: str, recording: Any, number: int) -> None:
    """Refuse a group that holds other than the samples that it declares."""
    declared = recording.groups[number].channel_group.cycles_nr
    held = len(recording.get_master(number))
    if held != declared:
        raise InputError(
            f"{file}: group {number + 1} declares {declared} samples and holds {held}; copy or "
            "export it again."
        )


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
