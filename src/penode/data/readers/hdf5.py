"""Variables of a MATLAB file of version 7.3, which is an HDF5 file, by the library h5py."""

import io
import math
from typing import Any

import h5py
import numpy as np

from penode.errors import InputError

# Beyond so many objects, or groups within each other, a file is no recording.
_OBJECTS = 10_000
_DEPTH = 32
# Beyond so many letters or references a dataset is no label and no list of signals.
_LIST = 1000


def variables(file: str, content: bytes) -> dict[str, Any]:
    """Return the variables of the file: arrays, text, structs as dicts, and lists of structs.

    None stands for what is left out: cells, objects, links. Refuses values that are kept in another
    file or are fewer than declared.
    """
    with h5py.File(io.BytesIO(content), "r") as opened:
        return _Walk(file, opened).group(opened, 0)


class _Walk:
    """A walk over the objects of a file, which ends however they refer to each other."""

    def __init__(self, file: str, opened: h5py.File) -> None:
        self._file = file
        self._opened = opened
        self._left = _OBJECTS

    def group(self, group: h5py.Group, depth: int) -> dict[str, Any]:
        """Return what a group holds itself, but MATLAB's own; links may lead to other files."""
        fields = {}
        for name in group:
            if not name.startswith("#"):
                own = group.get(name, getlink=True).__class__ is h5py.HardLink
                fields[name] = self._variable(group[name], depth) if own else None
        return fields

    def _variable(self, node: Any, depth: int) -> Any:
        """Return one variable: a struct is a group, a list of structs a group of references."""
        self._left -= 1
        if self._left < 0 or depth > _DEPTH:
            raise RecursionError
        if isinstance(node, h5py.Group):
            fields = self.group(node, depth + 1)
            lists = [part for part in fields.values() if isinstance(part, list)]
            if lists and len(lists) == len(fields):
                return [dict(zip(fields, parts, strict=True)) for parts in zip(*lists, strict=True)]
            return fields
        return self._values(node, depth) if isinstance(node, h5py.Dataset) else None

    def _values(self, node: h5py.Dataset, depth: int) -> Any:
        kind = node.attrs.get("MATLAB_class", b"")
        if kind == b"cell" or "MATLAB_empty" in node.attrs or not node.size:
            return None
        if h5py.check_ref_dtype(node.dtype) is h5py.Reference:
            references = np.ravel(self._read(node)) if node.size <= _LIST else ()
            return [
                self._variable(self._opened[reference], depth + 1) if reference else None
                for reference in references
            ]
        if kind == b"char":
            if node.size > _LIST or node.dtype.kind != "u":
                return None
            return "".join(map(chr, np.ravel(self._read(node))))
        if node.dtype.names == ("real", "imag"):
            parts = self._read(node)
            return (parts["real"] + 1j * parts["imag"]).T
        return self._read(node).T if node.dtype.kind in "biuf" else None

    def _read(self, node: h5py.Dataset) -> Any:
        """Return the values of a dataset; HDF5 makes zeros of those that are not stored."""
        if node.is_virtual or node.external:
            raise InputError(
                f"{self._file}: the values of {node.name} are in another file; copy them into "
                "this one."
            )
        if node.chunks is None:
            complete = node.id.get_storage_size() >= node.nbytes
        else:
            sides = zip(node.shape, node.chunks, strict=True)
            chunks = math.prod(math.ceil(side / chunk) for side, chunk in sides)
            complete = node.id.get_num_chunks() == chunks
        if not complete:
            raise InputError(
                f"{self._file}: {node.name} declares {node.size} values and holds fewer; copy or "
                "save it again."
            )
        return node[()]
