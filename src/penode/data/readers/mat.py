"""Reader of MATLAB files: version 7 and older by scipy, version 7.3 (HDF5) by h5py."""

import io
import math
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from penode.data.table import Column, Table, clean_names, clocks_within
from penode.errors import InputError, printable, require_extra

# A variable is an array, or a struct of such variables by name, or a list of structs.
_Variable: TypeAlias = Any

# Beyond so many columns a matrix is no bundle of channels; so are structs in an array.
_COLUMNS = 16
_STRUCTS = 256
# Structs within each other.
_DEPTH = 16
# What a file of version 7.3 begins with, behind a header of one of these sizes.
_HDF5 = b"\x89HDF\r\n\x1a\n"
_HEADERS = (0, 512, 1024, 2048, 4096)
# Values that one byte can be unpacked to.
_COMPRESSION = 1040


def read(file: str, source: BinaryIO) -> Table:
    """Read the numeric vectors of a MATLAB file, float64; scalars, text and objects are left out.

    The fields of a struct are called ``struct.field``, those of an array of structs
    ``struct1.field``, the columns of a matrix ``matrix_1``; a complex vector becomes
    ``vector.real`` and ``vector.imag``. A field ``time`` or ``t`` is the clock of the other fields,
    and of structs within as far as they are as long. The signals of a Simulink structure with time
    are called by their labels, else ``signals1``. Single numbers are kept apart. A damaged file
    makes the libraries raise what they will.
    """
    columns: dict[str, Column] = {}
    table = Table(columns)
    for name, variable in _variables(file, source.read()).items():
        table.numbers.update(_numbers_within(printable(name), variable))
        before = len(columns)
        for vectors, clock in _vectors_within(printable(name), variable, None):
            clean_names(file, [*vectors, *(twice for twice in vectors if twice in columns)])
            columns.update(vectors)
            if clock is not None:
                table.clocks.update(dict.fromkeys(vectors, clock))
        if len(columns) == before:
            table.left_out[printable(name)] = (
                "text, a cell, a link or another kind that is no vector"
            )
    if not table.columns:
        raise InputError(
            f"{file}: no numeric vector in this MATLAB file; save vectors or structs of vectors "
            "(table2struct(T, 'ToScalar', true) makes one of a table)."
        )
    return table


def _variables(file: str, content: bytes) -> dict[str, _Variable]:
    """Return the variables of a file of any version; only its library is imported."""
    if any(content.startswith(_HDF5, header) for header in _HEADERS):
        require_extra("h5py", "hdf5", f"{file}: a MATLAB file of version 7.3")
        from penode.data.readers.hdf5 import variables

        return variables(file, content)
    if not content.startswith(b"MATLAB"):
        raise InputError(
            f"{file}: no MATLAB file of version 5 to 7.3, or damaged; save it from MATLAB again."
        )
    from scipy.io import loadmat, whosmat

    for name, shape, kind in whosmat(io.BytesIO(content)):
        if kind != "sparse" and math.prod(shape) > _COMPRESSION * len(content):
            raise InputError(
                f"{file}: variable {name} declares {math.prod(shape)} values in a file of "
                f"{len(content)} bytes; the file is damaged, so save it from MATLAB again."
            )
    held = loadmat(io.BytesIO(content), simplify_cells=True)
    return {name: value for name, value in held.items() if not name.startswith("__")}


def _vectors_within(
    name: str, variable: _Variable, clock: tuple[str, int] | None, depth: int = 0
) -> Iterator[tuple[dict[str, Column], str | None]]:
    """Yield the vectors of a variable and of structs in it, with the column of their times.

    The clock is that of the struct around it: its column and length.
    """
    if depth > _DEPTH:
        raise RecursionError
    if isinstance(variable, list) and len(variable) <= _STRUCTS:
        for number, part in enumerate(variable, start=1):
            yield from _vectors_within(f"{name}{number}", part, clock, depth + 1)
    elif isinstance(variable, Mapping):
        fields = {f"{name}.{printable(part)}": held for part, held in _fields(variable).items()}
        own = {path: _vectors(path, held) for path, held in fields.items()}
        found = {column: len(v) for vectors in own.values() for column, v in vectors.items()}
        ties = clocks_within({column.removeprefix(f"{name}."): column for column in found})
        inner = next(((tie, found[tie]) for tie in ties.values()), clock)
        for path, held in fields.items():
            if own[path]:
                yield _tied(own[path], None if ties else clock, next(iter(ties.values()), None))
            else:
                yield from _vectors_within(path, held, inner, depth + 1)
    else:
        yield _tied(_vectors(name, variable), clock, None)


def _numbers_within(name: str, variable: _Variable, depth: int = 0) -> Iterator[tuple[str, float]]:
    """Yield the single numbers of a variable and of structs in it, by their names."""
    if isinstance(variable, Mapping) and depth <= _DEPTH:
        for part, held in variable.items():
            yield from _numbers_within(f"{name}.{printable(part)}", held, depth + 1)
    elif isinstance(variable, int | float | np.ndarray) and np.size(variable) == 1:
        value = np.asarray(variable)
        if value.dtype.kind in "iuf":
            yield name, float(value.reshape(()))


def _tied(
    vectors: dict[str, Column], outer: tuple[str, int] | None, own: str | None
) -> tuple[dict[str, Column], str | None]:
    """Return vectors and their clock; those of another length than an outer clock are none."""
    if outer is None:
        return vectors, own
    clock, length = outer
    return {name: v for name, v in vectors.items() if len(v) == length}, clock


def _fields(struct: Mapping[str, _Variable]) -> dict[str, _Variable]:
    """Return the fields of a struct, the signals of a Simulink structure among them."""
    signals = struct.get("signals")
    signals = [signals] if isinstance(signals, Mapping) else signals
    if not isinstance(signals, list) or not all(isinstance(s, Mapping) for s in signals):
        return dict(struct)
    fields = {name: part for name, part in struct.items() if name != "signals"}
    for number, signal in enumerate(signals, start=1):
        label = signal.get("label")
        named = isinstance(label, str) and label.strip()
        fields[label.strip() if named else f"signals{number}"] = signal.get("values")
    return fields


def _vectors(name: str, variable: _Variable) -> dict[str, Column]:
    """Return the vectors in a variable: itself, the columns of a matrix, or none."""
    if not isinstance(variable, np.ndarray) or variable.dtype.kind not in "biufc":
        return {}
    if variable.dtype.kind == "c":
        if variable.imag.any():
            return _vectors(f"{name}.real", variable.real) | _vectors(f"{name}.imag", variable.imag)
        variable = variable.real
    values = np.atleast_1d(variable.squeeze())
    if values.ndim == 1 and len(values) > 1:
        return {name: values.astype(np.float64)}
    if values.ndim != 2 or min(values.shape) > _COLUMNS:
        return {}
    rows = values if values.shape[0] < values.shape[1] else values.T
    return {f"{name}_{k}": row.astype(np.float64) for k, row in enumerate(rows, start=1)}
