"""One good recording, and the formats in which it may come."""

import io
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import polars as pl
from asammdf import MDF
from asammdf import Signal as MdfSignal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate

Columns = Mapping[str, np.ndarray]
NAMES = ("t", "u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el")


@cache
def recording() -> dict[str, np.ndarray]:
    """Return the columns of a quarter of a second of a machine at 1500 rpm."""
    run = simulate(TRACTION_300A, Lissajous(240.0, 50.0, 54.0), speed_rpm=1500.0, duration=0.25)
    time = run.time_step * np.arange(len(run.channels["u_d"]))
    return {"t": time, **{name: np.array(run.channels[name]) for name in NAMES[1:]}}


def changed(**columns: np.ndarray | None) -> dict[str, np.ndarray]:
    """Return the recording with some columns in place of its own, or without those that are None.

    Parameters
    ----------
    **columns : ndarray or None
    """
    return {n: v for n, v in {**recording(), **columns}.items() if v is not None}


def csv(columns: Columns | None = None, separator: str = ",", units: str = "") -> str:
    """Return text with a line of names and one for each sample.

    Parameters
    ----------
    columns : mapping of str to ndarray, optional
    separator : str
    units : str
        Line below the header.
    """
    columns = recording() if columns is None else columns
    rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
    lines = [separator.join(map(str, row)) for row in rows]
    return "\n".join([separator.join(columns), *([units] if units else []), *lines, ""])


def parquet(columns: Mapping[str, Any] | None = None, **options: Any) -> bytes:
    """Return a parquet file."""
    written = io.BytesIO()
    pl.DataFrame(dict(columns or recording())).write_parquet(written, **options)
    return written.getvalue()


def mat(variables: Mapping[str, Any] | None = None, **options: Any) -> bytes:
    """Return a MATLAB file of version 5."""
    written = io.BytesIO()
    savemat(written, dict(variables or recording()), oned_as="column", **options)
    return written.getvalue()


def hdf5(
    build: Callable[[h5py.File], object] | None = None, columns: Columns | None = None
) -> bytes:
    """Return a MATLAB file of version 7.3 with the columns and what is built beside them."""
    written = io.BytesIO()
    with h5py.File(written, "w", userblock_size=512) as file:
        for name, values in (recording() if columns is None else columns).items():
            file[name] = values
        if build:
            build(file)
    head = b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM"
    return head + written.getvalue()[len(head) :]


def mdf(
    *groups: Columns,
    units: Mapping[str, str] | None = None,
    conversion: Any = None,
    invalid: np.ndarray | None = None,
    version: str = "4.10",
) -> bytes:
    """Return an MDF file with a group for each mapping of columns, the recording by default."""
    with tempfile.TemporaryDirectory() as folder, MDF(version=version) as file:
        for columns in groups or (recording(),):
            file.append(
                [
                    MdfSignal(
                        np.asarray(values),
                        np.asarray(columns["t"]),
                        name=name,
                        unit=(units or {}).get(name, ""),
                        conversion=conversion if name == "u_d" else None,
                        invalidation_bits=invalid,
                    )
                    for name, values in columns.items()
                    if name != "t"
                ]
            )
        suffix = "mf4" if version[0] == "4" else "mdf"
        return Path(file.save(Path(folder) / f"made.{suffix}")).read_bytes()


def tdms(columns: Columns | None = None, **properties: Any) -> bytes:
    """Return a TDMS file with one group."""
    written = io.BytesIO()
    with TdmsWriter(written) as file:
        named = (recording() if columns is None else columns).items()
        file.write_segment(
            [ChannelObject("g", name, values, properties=properties) for name, values in named]
        )
    return written.getvalue()
