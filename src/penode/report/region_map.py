"""Maps over two quantities: labelled contours inside the recorded region, grey outside."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from scipy import ndimage

from penode.arrays import BoolArray, FloatArray, IntArray
from penode.report import palette, panels
from penode.report.quantities import decimals_for, fixed, labelled

#: About how many contour lines two panels have; more panels are smaller and have fewer.
_LEVELS = 10
_DOTS = 1500
#: Pixels: width of a row of panels, space between panels, least and greatest height of a panel.
_ROW_WIDTH, _GAP, _LOWEST, _HIGHEST = 866.0, 92.0, 260.0, 600.0
#: Width over height of a panel whose coordinates differ in unit.
_ASPECT = 1.3
#: Contour lines shorter than this many grid cells get no label.
_LABELLED = 14
#: Labels lie at least this many grid cells inside the region.
_INSIDE = 8
#: Labels keep this many grid cells between them, rows counting for more than they are wide.
_APART, _ROW_WEIGHT = 16.0, 1.7


@dataclass(frozen=True, eq=False)
class RegionGrid:
    """A grid, x (column,) and y (row,), on which maps are drawn, and the recorded points.

    ``supported`` (row, column) are the points in the excited region; ``names`` is markup;
    ``excited`` is (sample, 2).
    """

    x: FloatArray
    y: FloatArray
    supported: BoolArray
    excited: FloatArray
    names: tuple[str, str]
    units: tuple[str, str]

    @property
    def one_scale(self) -> bool:
        """Whether both coordinates have one unit, so that they are drawn to one scale."""
        return self.units[0] == self.units[1]

    @property
    def mesh(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates of every point, each of shape (row, column)."""
        x, y = np.meshgrid(self.x, self.y)
        return x, y


def region_maps(grid: RegionGrid, titles: Sequence[str], maps: FloatArray, unit: str) -> go.Figure:
    """Draw maps (map, row, column) of one unit side by side as labelled contours.

    Both axes are to one scale where they have one unit. Grey outside the supported region; the
    recorded points are dots. The titles are markup.
    """
    figure = panels.panelled(*_grids(grid, len(maps)))
    for col, (title, values) in enumerate(zip(titles, maps, strict=True), 1):
        inside = values[grid.supported & np.isfinite(values)]
        levels = nice_levels(inside, _LEVELS if len(maps) < 3 else _LEVELS // 2)
        for trace in (
            _shading(grid, values, unit, levels),
            _surroundings(grid),
            _dots(grid),
            _lines(grid, values, levels),
            _labels(grid, values, levels),
        ):
            figure.add_trace(trace, row=1, col=col)
        panels.panel_title(figure, title, 1, col, size=14)
        if grid.one_scale:
            figure.update_yaxes(scaleanchor=figure.data[-1].xaxis, col=col)
    (x, y), ticks = map(labelled, grid.names, grid.units), 4 if len(maps) > 2 else 6
    ends = [grid.x[0], grid.x[-1]]
    shape = {"constrain": "domain", "constraintoward": "left"}
    figure.update_xaxes(range=ends, nticks=ticks, title_text=x, **shape)
    figure.update_yaxes(range=[grid.y[0], grid.y[-1]], nticks=7, title_text=y, constrain="domain")
    return figure.update_layout(showlegend=False)


def _shading(grid: RegionGrid, values: FloatArray, unit: str, levels: FloatArray) -> go.Contour:
    steps = len(palette.SEQUENCE) - 1
    (x, y), (x_unit, y_unit) = grid.names, grid.units
    at = f"{x} %{{x:.4~g}} {x_unit}, {y} %{{y:.4~g}} {y_unit}"
    return go.Contour(
        x=grid.x,
        y=grid.y,
        z=values,
        colorscale=[[k / steps, colour.light] for k, colour in enumerate(palette.SEQUENCE)],
        zmin=levels[0],
        zmax=levels[-1],
        showscale=False,
        contours={"start": levels[0], "end": levels[-1], "coloring": "heatmap"},
        line={"width": 0},
        hovertemplate=f"{at}<br>%{{z:.4~g}} {unit}<extra></extra>",
    )


def _surroundings(grid: RegionGrid) -> go.Contour:
    """Cover what is not supported, outlined without the staircase of the grid's cells."""
    return go.Contour(
        x=grid.x,
        y=grid.y,
        z=ndimage.gaussian_filter(grid.supported.astype(np.float64), 1.2, mode="nearest"),
        contours={"type": "constraint", "operation": ">", "value": 0.5},
        fillcolor=palette.VEIL.light,
        line={"color": palette.OUTLINE.light, "width": 1.6, "dash": "dash"},
        hoverinfo="skip",
    )


def _dots(grid: RegionGrid) -> go.Scatter:
    x, y = grid.excited[:: max(1, len(grid.excited) // _DOTS)].T
    marker = {"size": 2, "color": palette.RECORDED.light}
    return go.Scatter(x=x, y=y, mode="markers", marker=marker, hoverinfo="skip")


def _lines(grid: RegionGrid, values: FloatArray, levels: FloatArray) -> go.Contour:
    start, end, step = levels[0], levels[-1], levels[1] - levels[0]
    return go.Contour(
        x=grid.x,
        y=grid.y,
        z=np.where(grid.supported, values, np.nan),
        contours={"start": start, "end": end, "size": step, "coloring": "none"},
        line={"color": palette.CONTOUR.light, "width": 1},
        hoverinfo="skip",
    )


def _labels(grid: RegionGrid, values: FloatArray, levels: FloatArray) -> go.Scatter:
    rows, columns, numbers = label_places(values, grid.supported, levels).T
    decimals = decimals_for(10 * float(levels[1] - levels[0]), 0.0)
    return go.Scatter(
        x=grid.x[columns],
        y=grid.y[rows],
        text=[f"<b>{fixed(float(levels[number]), decimals)}</b>" for number in numbers],
        mode="text",
        textfont={"color": palette.INK.light, "size": 12, "shadow": palette.HALO.light},
        hoverinfo="skip",
    )


def _grids(grid: RegionGrid, count: int) -> tuple[panels.Grid, panels.Grid]:
    """Return a row and a pile of panels, as wide as maps drawn to one scale need them."""
    aspect = float(np.ptp(grid.x) / np.ptp(grid.y)) if grid.one_scale else _ASPECT
    widest = (_ROW_WIDTH - (count - 1) * _GAP) / count
    height = float(np.clip(widest / aspect, _LOWEST, _HIGHEST))
    width = min(widest, height * aspect)
    piled = float(np.clip(300.0 / aspect, 200.0, 420.0))
    wide = panels.Grid([width] * count, [height], _GAP, width=_ROW_WIDTH)
    return wide, panels.Grid([1.0], [piled] * count, gaps=[84.0] * (count - 1))


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
