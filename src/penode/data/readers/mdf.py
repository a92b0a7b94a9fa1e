"""Reader of MDF measurement files (ASAM MDF version 4), by the library asammdf."""

import gc
import importlib
import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from penode.data.signals import Signal, table_of
from penode.data.table import Table
from penode.errors import InputError


def read(path: Path) -> Table:
    """Read the numeric channels of an MDF file.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    Table
        Channels of one axis as float64, in physical units as the file's conversions give them.
        The times of each channel group are its clock; see `penode.data.signals.table_of`. A
        sample that the file calls invalid is left out together with its time, which leaves a gap.

    Raises
    ------
    InputError
        If asammdf is not installed, or the file is no MDF file or damaged.
    OSError
        If the file cannot be opened.
    """
    file = str(path)
    raw = path.read_bytes()
    if not raw.startswith(b"MDF"):
        raise InputError(f"{file}: the content is no MDF file; export the recording as MDF 4.")
    try:
        library = importlib.import_module("asammdf")
    except ImportError as error:
        raise InputError(
            f"{file}: reading MDF needs the library asammdf; pip install 'penode[mdf]'."
        ) from error
    with _quiet_finalisers():
        try:
            # From memory, as the library writes into a file that was not closed properly.
            with library.MDF(io.BytesIO(raw)) as content:
                return table_of(file, _signals(content))
        except InputError:
            raise
        except Exception as error:  # the library has no base class for what damage raises
            reason = type(error).__name__
        gc.collect()
    raise InputError(
        f"{file}: the MDF file is damaged or of an unknown kind ({reason}); export it again as "
        "MDF 4."
    )


@contextmanager
def _quiet_finalisers() -> Iterator[None]:
    """Print nothing when the library's half-made object of a damaged file fails to be closed."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        sys.unraisablehook = hook


def _signals(content: Any) -> list[Signal]:
    """Return the numeric channels of all groups, without the times themselves."""
    signals = []
    for number, group in enumerate(content.groups):
        master = content.masters_db.get(number)
        for index in range(len(group.channels)):
            if index == master:
                continue
            signal = content.get(group=number, index=index)
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "biuf":
                values, times = (a.astype(np.float64) for a in (signal.samples, signal.timestamps))
                name, unit = signal.name, signal.unit or ""
                signals.append(Signal(f"group {number + 1}", name, unit, values, times))
    return signals
