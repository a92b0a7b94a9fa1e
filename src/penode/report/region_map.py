"""Maps over two quantities: labelled contours inside the recorded region, grey outside."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from scipy import ndimage

from penode.arrays import BoolArray, FloatArray
from penode.report import palette, panels
from penode.report.contours import label_places, nice_levels
from penode.report.quantities import decimals_for, fixed

#: About how many contour lines two panels have; more panels are smaller and have fewer.
_LEVELS = 10
_DOTS = 1500
#: Pixels: width of a row of panels, space between panels, least and greatest height of a panel.
_ROW_WIDTH, _GAP, _LOWEST, _HIGHEST = 866.0, 92.0, 260.0, 600.0
#: Width over height of a panel whose coordinates differ in unit.
_ASPECT = 1.3


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
    def titles(self) -> tuple[str, str]:
        """Markup of the two coordinates with their units."""
        x, y = (f"{n} in {u}" if u else n for n, u in zip(self.names, self.units, strict=True))
        return x, y

    @property
    def mesh(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates of every point, each of shape (row, column)."""
        x, y = np.meshgrid(self.x, self.y)
        return x, y


@dataclass(frozen=True, eq=False)
class RegionMap:
    """One quantity (row, column) over a `RegionGrid`; the title is markup with the unit."""

    title: str
    values: FloatArray
    unit: str


def region_maps(grid: RegionGrid, maps: Sequence[RegionMap]) -> go.Figure:
    """Draw maps side by side as labelled contours, both axes to one scale where they have one unit.

    Grey outside the supported region; the recorded points are dots.
    """
    figure = panels.blank_figure()
    panels.place(figure, *_boxes(grid, len(maps)))
    for panel, one in enumerate(maps):
        axes = {"xaxis": panels.axis_id("x", panel), "yaxis": panels.axis_id("y", panel)}
        inside = one.values[grid.supported & np.isfinite(one.values)]
        levels = nice_levels(inside, _LEVELS if len(maps) < 3 else _LEVELS // 2)
        for trace in (
            _shading(grid, one, levels),
            _surroundings(grid),
            _dots(grid),
            _lines(grid, one, levels),
            _labels(grid, one, levels),
        ):
            figure.add_trace(trace.update(axes))
        _set_axes(figure, grid, one.title, panel)
    if len(maps) > 2:
        figure.update_xaxes(nticks=4)
    figure.update_layout(showlegend=False, hovermode="closest")
    return figure


def _shading(grid: RegionGrid, one: RegionMap, levels: FloatArray) -> go.Contour:
    steps = len(palette.SEQUENCE) - 1
    (x, y), (x_unit, y_unit) = grid.names, grid.units
    return go.Contour(
        x=panels.compact(grid.x),
        y=panels.compact(grid.y),
        z=panels.compact(one.values),
        colorscale=[[k / steps, colour.light] for k, colour in enumerate(palette.SEQUENCE)],
        zmin=levels[0],
        zmax=levels[-1],
        showscale=False,
        contours={"start": levels[0], "end": levels[-1], "coloring": "heatmap"},
        line={"width": 0},
        hovertemplate=(
            f"{x} %{{x:.4~g}} {x_unit}, {y} %{{y:.4~g}} {y_unit}<br>"
            f"%{{z:.4~g}} {one.unit}<extra></extra>"
        ),
    )


def _surroundings(grid: RegionGrid) -> go.Contour:
    """Cover what is not supported, outlined without the staircase of the grid's cells."""
    smooth = ndimage.gaussian_filter(grid.supported.astype(np.float64), 1.2, mode="nearest")
    return go.Contour(
        x=panels.compact(grid.x),
        y=panels.compact(grid.y),
        z=panels.compact(smooth),
        contours={"type": "constraint", "operation": ">", "value": 0.5},
        fillcolor=palette.VEIL.light,
        line={"color": palette.OUTLINE.light, "width": 1.6, "dash": "dash"},
        hoverinfo="skip",
        showlegend=False,
    )


def _dots(grid: RegionGrid) -> go.Scatter:
    dots = grid.excited[:: max(1, len(grid.excited) // _DOTS)]
    return go.Scatter(
        x=panels.compact(dots[:, 0]),
        y=panels.compact(dots[:, 1]),
        mode="markers",
        marker={"size": 2, "color": palette.RECORDED.light},
        hoverinfo="skip",
    )


def _lines(grid: RegionGrid, one: RegionMap, levels: FloatArray) -> go.Contour:
    return go.Contour(
        x=panels.compact(grid.x),
        y=panels.compact(grid.y),
        z=panels.compact(np.where(grid.supported, one.values, np.nan)),
        contours={
            "start": levels[0],
            "end": levels[-1],
            "size": levels[1] - levels[0],
            "coloring": "none",
        },
        line={"color": palette.CONTOUR.light, "width": 1},
        hoverinfo="skip",
    )


def _labels(grid: RegionGrid, one: RegionMap, levels: FloatArray) -> go.Scatter:
    rows, columns, numbers = label_places(one.values, grid.supported, levels).T
    decimals = decimals_for(10 * float(levels[1] - levels[0]), 0.0)
    return go.Scatter(
        x=grid.x[columns],
        y=grid.y[rows],
        text=[f"<b>{fixed(float(levels[number]), decimals)}</b>" for number in numbers],
        mode="text",
        textfont={"color": palette.INK.light, "size": 12, "shadow": palette.HALO.light},
        hoverinfo="skip",
    )


def _boxes(
    grid: RegionGrid, count: int
) -> tuple[tuple[list[panels.Box], float], tuple[list[panels.Box], float]]:
    """Return boxes in a row and in a pile, as wide as maps drawn to one scale need them."""
    aspect = float(np.ptp(grid.x) / np.ptp(grid.y)) if grid.one_scale else _ASPECT
    widest = (_ROW_WIDTH - (count - 1) * _GAP) / count
    height = float(np.clip(widest / aspect, _LOWEST, _HIGHEST))
    width = min(widest, height * aspect)
    rest = _ROW_WIDTH - count * (width + _GAP)  # of an empty column; below zero in a full row
    wide, total = panels.grid([width] * count + [rest], [height], _GAP, [])
    piled = float(np.clip(300.0 / aspect, 200.0, 420.0))
    return (wide[:count], total), panels.grid([1.0], [piled] * count, 0.0, [84.0] * (count - 1))


def _set_axes(figure: go.Figure, grid: RegionGrid, title: str, panel: int) -> None:
    x, y = panels.axis_id("x", panel), panels.axis_id("y", panel)
    figure.layout[panels.axis_key("x", panel)].update(
        anchor=y,
        range=[grid.x[0], grid.x[-1]],
        constrain="domain",
        constraintoward="left",
        nticks=6,
        title_text=grid.titles[0],
    )
    figure.layout[panels.axis_key("y", panel)].update(
        anchor=x,
        range=[grid.y[0], grid.y[-1]],
        constrain="domain",
        scaleanchor=x if grid.one_scale else None,
        nticks=7,
        title_text=grid.titles[1],
    )
    figure.add_annotation(
        text=title,
        x=0,
        xref=f"{x} domain",
        xanchor="left",
        y=1,
        yref=f"{y} domain",
        yanchor="bottom",
        yshift=4,
        font={"size": 14},
    )
