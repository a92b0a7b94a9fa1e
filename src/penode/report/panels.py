"""The look all figures share, and panels in a grid or, on narrow pages, in a pile."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray
from penode.report import palette

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
MARGIN = {"l": 64, "r": 18, "t": 34, "b": 52}

_AXIS: dict[str, Any] = {
    "gridcolor": palette.GRID.light,
    "linecolor": palette.LINE.light,
    "zerolinecolor": palette.LINE.light,
    "tickcolor": palette.LINE.light,
    "tickfont": {"color": palette.MUTED.light, "size": 12},
    "title": {"font": {"color": palette.INK.light, "size": 13}, "standoff": 8},
    "ticks": "outside",
    "ticklen": 4,
    "showline": True,
    "zeroline": False,
    "automargin": False,
}
_SCENE_AXIS: dict[str, Any] = {
    "gridcolor": palette.LINE.light,
    "linecolor": palette.LINE.light,
    "zerolinecolor": palette.LINE.light,
    "color": palette.INK.light,
    "tickfont": {"color": palette.MUTED.light, "size": 11},
    "showbackground": False,
    "showspikes": False,
}
_TEMPLATE = go.layout.Template(
    layout={
        "font": {"family": FONT, "color": palette.INK.light, "size": 13},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "scene": {"xaxis": _SCENE_AXIS, "yaxis": _SCENE_AXIS, "zaxis": _SCENE_AXIS},
        "margin": MARGIN,
        "hoverlabel": {
            "bgcolor": palette.PAGE.light,
            "bordercolor": palette.LINE.light,
            "font": {"family": FONT, "color": palette.INK.light, "size": 12.5},
        },
        "legend": {
            "orientation": "h",
            "x": 0,
            "xanchor": "left",
            "y": 1,
            "yref": "container",
            "yanchor": "top",
            "bgcolor": "rgba(0,0,0,0)",
            "font": {"color": palette.INK.light, "size": 12.5},
            "itemsizing": "constant",
        },
        "annotationdefaults": {"showarrow": False, "font": {"size": 12.5}},
    }
)


@dataclass(frozen=True)
class Box:
    """Where one panel lies, as fractions of the plotting area from its lower left corner."""

    left: float
    right: float
    bottom: float
    top: float


def blank_figure() -> go.Figure:
    """Return an empty figure with the shared look."""
    return go.Figure(layout={"template": _TEMPLATE})


def axis_id(letter: str, panel: int) -> str:
    """Return plotly's short name of an axis of a panel, counted from 0: ``x``, ``x2``, ``x3``."""
    return letter if panel == 0 else f"{letter}{panel + 1}"


def axis_key(letter: str, panel: int) -> str:
    """Return the layout entry of an axis of a panel, counted from 0: ``xaxis``, ``xaxis2``."""
    return axis_id(letter, panel).replace(letter, f"{letter}axis")


def grid(
    widths: Sequence[float], heights: Sequence[float], gap: float, gaps: Sequence[float]
) -> tuple[list[Box], float]:
    """Lay boxes out row by row, and return them with the height of the plotting area in pixels.

    ``widths`` and the ``gap`` between columns are relative; ``heights`` and the ``gaps`` under each
    row but the last are in pixels.
    """
    below = [*gaps, 0.0]
    total = sum(heights) + sum(gaps)
    full = sum(widths) + gap * (len(widths) - 1)
    tops = [0.0, *accumulate(h + g for h, g in zip(heights, below, strict=True))]
    lefts = [0.0, *accumulate(width + gap for width in widths)]
    boxes = [
        Box(left / full, (left + width) / full, 1 - (top + height) / total, 1 - top / total)
        for top, height in zip(tops, heights, strict=False)
        for left, width in zip(lefts, widths, strict=False)
    ]
    return boxes, total


def place(
    figure: go.Figure, wide: tuple[list[Box], float], narrow: tuple[list[Box], float]
) -> None:
    """Put a figure's panels where the boxes of `grid` say, for wide and for narrow pages.

    Changes the figure in place: its axes' domains, its height and ``layout.meta["narrow"]``.
    """
    figure.update_layout(**_placed(wide), meta={"narrow": _placed(narrow)})


def _placed(boxes_and_height: tuple[list[Box], float]) -> dict[str, Any]:
    boxes, height = boxes_and_height
    layout: dict[str, Any] = {"height": round(height + MARGIN["t"] + MARGIN["b"])}
    for panel, box in enumerate(boxes):
        layout[axis_key("x", panel)] = {"domain": _domain(box.left, box.right)}
        layout[axis_key("y", panel)] = {"domain": _domain(box.bottom, box.top)}
    return layout


def _domain(low: float, high: float) -> list[float]:
    return [round(max(low, 0.0), 6), round(min(high, 1.0), 6)]


def compact(values: FloatArray) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Return values in single precision, for drawing only, which halves their size in the page."""
    largest = np.finfo(np.float32).max
    return np.asarray(np.clip(values, -largest, largest), dtype=np.float32)


def envelope(values: FloatArray, points: int) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Choose about ``points`` samples that draw the same curve: lowest and highest of each stretch.

    Returns ascending indices into ``values`` (time,), of which those from the first NaN on are left
    out.
    """
    broken = np.flatnonzero(~np.isfinite(values))
    length = int(broken[0]) if broken.size else len(values)
    if length <= points:
        return np.arange(length)
    size = -(-length // (points // 2))
    whole = length // size
    stretches = values[: whole * size].reshape(whole, size)
    start = np.arange(whole) * size
    low, high = start + stretches.argmin(axis=1), start + stretches.argmax(axis=1)
    rest = np.arange(whole * size, length)
    return np.unique(np.concatenate([[0], low, high, rest, [length - 1]]))
