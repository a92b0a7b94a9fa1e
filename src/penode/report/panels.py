"""The look all figures share, and panels in a grid or, on narrow pages, in a pile.

Panels are those of plotly's `make_subplots`: row by row from the top left, rows and columns counted
from 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, product
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from penode.arrays import FloatArray
from penode.report import palette

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
MARGIN = {"l": 64, "r": 18, "t": 34, "b": 52}
#: Labels of lines keep this fraction of a panel's width between them.
_LABEL = 0.07

_LINES = dict.fromkeys(("gridcolor", "linecolor", "zerolinecolor"), palette.LINE.light)
_AXIS: dict[str, Any] = _LINES | {
    "gridcolor": palette.GRID.light,
    "tickcolor": palette.LINE.light,
    "tickfont": {"color": palette.MUTED.light, "size": 12},
    "title": {"font": {"color": palette.INK.light, "size": 13}, "standoff": 8},
    "ticks": "outside",
    "ticklen": 4,
    "showline": True,
    "zeroline": False,
    "automargin": False,
}
_SCENE_AXIS: dict[str, Any] = _LINES | {
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
        "hovermode": "closest",
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
class Grid:
    """Where panels lie, row by row.

    ``widths`` and the ``gap`` between columns are parts of ``width``, by default of their sum;
    ``heights`` and the ``gaps`` under each row but the last are in pixels.
    """

    widths: Sequence[float]
    heights: Sequence[float]
    gap: float = 0.0
    gaps: Sequence[float] = ()
    width: float = 0.0

    def layout(self, order: Sequence[int] = ()) -> dict[str, Any]:
        """Return the layout's entries; box k holds panel k, or panel ``order[k]``."""
        total = sum(self.heights) + sum(self.gaps)
        full = self.width or sum(self.widths) + self.gap * (len(self.widths) - 1)
        downwards = zip(self.heights, [*self.gaps, 0.0], strict=True)
        tops = [0.0, *accumulate(height + gap for height, gap in downwards)]
        lefts = [0.0, *accumulate(width + self.gap for width in self.widths)]
        boxes = product(
            zip(tops, self.heights, strict=False), zip(lefts, self.widths, strict=False)
        )
        layout: dict[str, Any] = {"height": round(total + MARGIN["t"] + MARGIN["b"])}
        for box, ((top, height), (left, width)) in enumerate(boxes):
            panel = order[box] if order else box
            layout[axis_key("x", panel)] = {"domain": _domain(left / full, (left + width) / full)}
            layout[axis_key("y", panel)] = {
                "domain": _domain(1 - (top + height) / total, 1 - top / total)
            }
        return layout


def blank_figure() -> go.Figure:
    """Return an empty figure with the shared look."""
    return go.Figure(layout={"template": _TEMPLATE})


def panelled(wide: Grid, narrow: Grid | None = None, order: Sequence[int] = ()) -> go.Figure:
    """Return an empty figure of panels, whose columns share x; in another grid on narrow pages.

    ``order`` says which panel each box of the narrow grid holds.
    """
    figure = make_subplots(len(wide.heights), len(wide.widths), shared_xaxes=True)
    narrow_layout = (narrow or wide).layout(order)
    return figure.update_layout(template=_TEMPLATE, **wide.layout(), meta={"narrow": narrow_layout})


def axis_key(letter: str, panel: int) -> str:
    """Return the layout entry of an axis of a panel, counted from 0: ``xaxis``, ``xaxis2``."""
    return f"{letter}axis{panel + 1 if panel else ''}"


def panel_title(figure: go.Figure, text: str, row: int, col: int, size: float = 12.5) -> None:
    """Write markup above a panel, at its left."""
    at = {"x": 0, "xref": "x domain", "y": 1, "yref": "y domain", "yshift": 4}
    figure.add_annotation(
        text=text, row=row, col=col, xanchor="left", yanchor="bottom", font={"size": size}, **at
    )


def mark_lines(
    figure: go.Figure, lines: Sequence[tuple[float, str]], rows: Sequence[int], width: float
) -> None:
    """Mark places (x, label) by dotted lines through rows of panels, labelled where there is room.

    The labels stand above the first of the rows; ``width`` is that of the panel in units of x.
    """
    labelled: list[float] = []
    colour = palette.MARKER_LINE.light
    for at, label in lines:
        room = all(abs(at - other) >= _LABEL * width for other in labelled)
        for row in rows:
            style = {"line": {"color": colour, "width": 1, "dash": "dot"}, "layer": "below"}
            figure.add_vline(at, row=row, col=1, **style)
        if room:
            labelled.append(at)
            place = {"xref": "x", "y": 1, "yref": "y domain", "yanchor": "bottom"}
            font = {"color": colour, "size": 12}
            figure.add_annotation(text=label, x=at, row=rows[0], col=1, font=font, **place)


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


def peaks(values: FloatArray, points: int) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Return the index of the largest value of each of about ``points`` stretches."""
    size = -(-len(values) // points)
    whole = len(values) // size
    stretches = values[: whole * size].reshape(whole, size)
    return np.asarray(np.arange(whole) * size + stretches.argmax(axis=1))


def decades(values: FloatArray, most: float) -> list[float]:
    """Return logarithmic limits of an axis, at most so many decades, that hold the largest."""
    visible = values[np.isfinite(values) & (values > 0)]
    if not visible.size:
        return [-1.0, 0.0]
    low, high = np.log10(np.quantile(visible, 0.02)), np.log10(visible.max())
    return [float(max(low, high - most)) - 0.1, float(high) + 0.25]
