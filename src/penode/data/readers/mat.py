"""Reader of MATLAB files: version 7 and older by scipy, version 7.3 (HDF5) by h5py."""

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from penode.arrays import FloatArray
from penode.data.table import Table, clocks_within
from penode.errors import InputError

# A variable is an array, or a struct of such variables by name, or a list of structs.
_Variable: TypeAlias = Any

# What the two libraries raise at a damaged file.
_DAMAGED = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    RuntimeError,
    OSError,
    MatReadError,
    zlib.error,
)

# Beyond so many columns a matrix is no bundle of channels.
_COLUMNS = 16


def read(path: Path) -> Table:
    """Read the numeric vectors of a MATLAB file.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    Table
        Vectors as float64. The fields of a struct are called ``struct.field``, the columns of a
        matrix ``matrix_1`` and so on. A field ``time`` or ``t`` is the clock of the other fields.
        The signals of a Simulink structure with time are fields called by their labels,
        ``signals1`` and so on where they have none. Scalars, text and objects are left out.

    Raises
    ------
    InputError
        If the file is no MATLAB file, damaged, or holds no numeric vector.
    OSError
        If the file cannot be opened.
    """
    file = str(path)
    with path.open("rb") as opened:
        start = opened.read(128)
    try:
        variables = _read_hdf5(path) if h5py.is_hdf5(path) else _read_old(path, start)
    except _DAMAGED as error:
        raise InputError(
            f"{file}: not a MATLAB file, or damaged; save it from MATLAB again."
        ) from error
    table = Table({})
    for name, variable in variables.items():
        _add(table, name, variable)
    if not table.columns:
        raise InputError(
            f"{file}: no numeric vector in this MATLAB file; save vectors or structs of vectors "
            "(table2struct(T, 'ToScalar', true) makes one of a table)."
        )
    return table


def _add(table: Table, name: str, variable: _Variable) -> None:
    """Add what a variable holds to the table."""
    if isinstance(variable, Mapping):
        fields = {f"{name}.{field}": part for field, part in _fields(variable).items()}
        columns = {k: v for field, part in fields.items() for k, v in _vectors(field, part).items()}
        table.clocks.update(clocks_within({n.removeprefix(f"{name}."): n for n in columns}))
    else:
        columns = _vectors(name, variable)
    table.columns.update(columns)


def _fields(struct: Mapping[str, _Variable]) -> dict[str, _Variable]:
    """Return the fields of a struct, the signals of a Simulink structure among them."""
    signals = struct.get("signals")
    signals = [signals] if isinstance(signals, Mapping) else signals
    fields = {name: part for name, part in struct.items() if name != "signals"}
    for number, signal in enumerate(signals if isinstance(signals, list) else [], start=1):
        label = signal.get("label")
        named = isinstance(label, str) and label.strip()
        fields[label.strip() if named else f"signals{number}"] = signal.get("values")
    return fields


def _vectors(name: str, variable: _Variable) -> dict[str, FloatArray]:
    """Return the vectors in a variable: itself, the columns of a matrix, or none."""
    if not isinstance(variable, np.ndarray) or variable.dtype.kind not in "biuf":
        return {}
    values = np.atleast_1d(variable.squeeze()).astype(np.float64)
    if values.ndim == 1 and len(values) > 1:
        return {name: values}
    if values.ndim != 2 or min(values.shape) > _COLUMNS:
        return {}
    rows = values if values.shape[0] < values.shape[1] else values.T
    return {f"{name}_{k}": row for k, row in enumerate(rows, start=1)}


# --- version 7 and older ------------------------------------------------------------------------


def _read_old(path: Path, start: bytes) -> dict[str, _Variable]:
    if not start.startswith(b"MATLAB"):
        raise ValueError("no MATLAB header")
    variables = loadmat(path, simplify_cells=True)
    return {name: value for name, value in variables.items() if not name.startswith("__")}


# --- version 7.3 --------------------------------------------------------------------------------


def _read_hdf5(path: Path) -> dict[str, _Variable]:
    with h5py.File(path) as content:
        return {name: _hdf5(content, node) for name, node in content.items() if name[0] != "#"}


def _hdf5(content: Any, node: Any) -> _Variable:
    """Return one variable: a struct is a group, a list of structs a group of references."""
    if isinstance(node, h5py.Group):
        fields = {name: _hdf5(content, part) for name, part in node.items()}
        lists = [part for part in fields.values() if isinstance(part, list)]
        if lists and len(lists) == len(fields):
            return [dict(zip(fields, parts, strict=True)) for parts in zip(*lists, strict=True)]
        return fields
    kind = node.attrs.get("MATLAB_class", b"")
    if kind == b"cell" or "MATLAB_empty" in node.attrs:
        return None
    if node.dtype == h5py.ref_dtype:
        return [_hdf5(content, content[reference]) for reference in np.ravel(node[()])]
    if kind == b"char":
        return "".join(chr(code) for code in np.ravel(node[()]))
    return node[()].T
