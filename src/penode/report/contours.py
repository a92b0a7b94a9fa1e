"""Contour lines: the values at which they are drawn, and the places of their labels."""

import numpy as np
from scipy import ndimage

from penode.arrays import BoolArray, FloatArray, IntArray

#: Contour lines shorter than this many grid cells get no label.
_LABELLED = 14
#: Labels lie at least this many grid cells inside the region.
_INSIDE = 8
#: Labels keep this many grid cells between them, rows counting for more than they are wide.
_APART, _ROW_WEIGHT = 16.0, 1.7


def nice_levels(values: FloatArray, count: int) -> FloatArray:
    """Return about ``count`` levels that cover finite values: 1, 2 or 5 times powers of ten."""
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high), 1e-30):
        span = max(abs(low), 1.0) * 0.1
    raw = span / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min((1, 2, 5, 10), key=lambda factor: abs(np.log(factor * power / raw)))
    first, last = np.floor(low / step), np.ceil(high / step)
    return np.asarray(np.arange(first, max(last, first + 1) + 1) * step)


def label_places(values: FloatArray, supported: BoolArray, levels: FloatArray) -> IntArray:
    """Choose a grid point for the label of every contour line, well inside and well apart.

    ``values`` and ``supported`` are (row, column); the result, (label, 3), is row, column and
    level.
    """
    depth = ndimage.distance_transform_edt(np.pad(supported, 1))[1:-1, 1:-1]
    rows, columns = np.indices(values.shape)
    room = np.full(values.shape, np.inf)
    places = []
    for number, level in enumerate(levels):
        lines, count = ndimage.label(_crossings(values, level) & supported, np.ones((3, 3)))
        for line in range(1, count + 1):
            free = (lines == line) & (depth >= _INSIDE) & (room >= _APART)
            if (lines == line).sum() < _LABELLED or not free.any():
                continue
            score = np.where(free, np.minimum(depth, room / 2), -1.0)
            row, column = np.unravel_index(int(np.argmax(score)), values.shape)
            places.append((int(row), int(column), number))
            distance = np.hypot(_ROW_WEIGHT * (rows - row), columns - column)
            room = np.minimum(room, distance)
    return np.array(places, dtype=np.int64).reshape(-1, 3)


def _crossings(values: FloatArray, level: float) -> BoolArray:
    """Return the grid points next to which the map passes a level."""
    above = values >= level
    crossed = np.zeros(values.shape, dtype=np.bool_)
    crossed[:, :-1] |= above[:, :-1] != above[:, 1:]
    crossed[:-1] |= above[:-1] != above[1:]
    return crossed
