"""Learned maps of any model over the states: curves of one state, contours over two."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.report import palette, panels
from penode.report.document import Figure
from penode.report.map_values import MARGIN, MapValues, map_columns, map_values, region_grid
from penode.report.quantities import number, symbol
from penode.report.region_map import RegionGrid, RegionMap, region_maps
from penode.report.statements import listed, range_text

_CURVE_POINTS, _GRID_POINTS = 241, 81
#: Contour panels side by side.
_BESIDE = 2
_WHOLE = slice(None)
_BAND = (
    "It allows for residuals that are correlated in time and for the spread over the horizons that "
    "agree, and it holds if the model's structure is right."
)


def map_figures(fit: Fit, name: str) -> list[Figure]:
    """Draw a learned map, with its 95 % band where the fit has one: curves or contours.

    Empty where the map depends on something other than one or two states.
    """
    columns = map_columns(fit, name) or ()
    drawn = {1: _curves, 2: _contours}.get(len(columns))
    return drawn(fit, name, columns) if drawn else []


def band_title(name: str, half: FloatArray, unit: str, over: str) -> str:
    """Say how narrow a band is from half its width, (point, ...), in the excited region."""
    most, nearly_all = (number(float(np.quantile(half, part)), 2) for part in (0.5, 0.95))
    space = "\N{NO-BREAK SPACE}" if unit else ""
    return (
        f"{name} is known to ±{most}{space}{unit} over half of the {over}, to "
        f"±{nearly_all}{space}{unit} over 95 % of them"
    )


def _curves(fit: Fit, name: str, columns: tuple[int, ...]) -> list[Figure]:
    (column,) = columns
    state, unit = fit.model.states[column], fit.model.state_units[column]
    recorded = fit.excited[:, column]
    margin = MARGIN * max(float(np.ptp(recorded)), 1e-9)
    axis = np.linspace(recorded.min() - margin, recorded.max() + margin, _CURVE_POINTS)
    values = map_values(fit, name, columns, axis[:, None])
    figure = panels.blank_figure()
    count = len(values.values)
    boxes = panels.grid([1.0], [300.0 if count == 1 else 190.0] * count, 0.0, [34.0] * (count - 1))
    panels.place(figure, boxes, boxes)
    for panel in range(count):
        _draw_curve(figure, values, axis, panel)
        title = f"{symbol(state)} in {unit}".removesuffix(" in ") if panel == count - 1 else None
        _set_curve_axes(figure, values, panel, title)
    figure.update_layout(hovermode="closest", margin={"t": 40})
    caption = (
        f"Solid where {state} was recorded, dotted outside, where the map is an extrapolation. "
    )
    has_band = np.isfinite(values.half_band[:, values.inside]).any()
    caption += f"Shaded: the 95 % band. {_BAND}" if has_band else "The fit has no band of this map."
    return [Figure(_title(fit, values, state), caption, figure)]


def _draw_curve(figure: go.Figure, values: MapValues, axis: FloatArray, panel: int) -> None:
    curve, half = values.values[panel], values.half_band[panel]
    place = {
        "xaxis": panels.axis_id("x", panel),
        "yaxis": panels.axis_id("y", panel),
        "showlegend": panel == 0,
    }
    finite = np.isfinite(half) & values.inside
    if finite.any():
        ends = np.concatenate([curve[finite] - half[finite], (curve[finite] + half[finite])[::-1]])
        figure.add_trace(
            go.Scatter(
                x=panels.compact(np.concatenate([axis[finite], axis[finite][::-1]])),
                y=panels.compact(ends),
                mode="lines",
                line={"width": 0},
                fill="toself",
                fillcolor=palette.INTERVAL.light,
                name="95 % band",
                hoverinfo="skip",
                **place,
            )
        )
    for label, shown, dash in (
        ("recorded", values.inside, "solid"),
        ("extrapolated", ~values.inside, "dot"),
    ):
        figure.add_trace(
            go.Scatter(
                x=panels.compact(axis),
                y=panels.compact(np.where(shown, curve, np.nan)),
                mode="lines",
                line={"color": palette.ESTIMATE.light, "width": 2, "dash": dash},
                name=label,
                hovertemplate=f"%{{x:.4~g}}: %{{y:.4~g}} {values.scale.unit}<extra></extra>",
                **place,
            )
        )


def _set_curve_axes(figure: go.Figure, values: MapValues, panel: int, title: str | None) -> None:
    x, y = panels.axis_id("x", panel), panels.axis_id("y", panel)
    figure.layout[panels.axis_key("x", panel)].update(
        anchor=y,
        matches=None if panel == 0 else "x",
        showticklabels=title is not None,
        title_text=title,
    )
    shown = f"{values.titles[panel]} in {values.scale.unit}".removesuffix(" in ")
    figure.layout[panels.axis_key("y", panel)].update(anchor=x, title_text=shown)


def _contours(fit: Fit, name: str, columns: tuple[int, ...]) -> list[Figure]:
    grid = region_grid(fit, (columns[0], columns[1]), _GRID_POINTS)
    mesh = np.stack(grid.mesh, axis=-1).reshape(-1, 2)
    values = map_values(fit, name, columns, mesh)
    states = listed([fit.model.states[column] for column in columns])
    caption = (
        "Inside the dashed outline lie the recorded states (dots). Outside it, greyed, the map is "
        "an extrapolation."
    )
    count = len(values.values)
    parts = [slice(k, min(k + _BESIDE, count)) for k in range(0, count, _BESIDE)]
    figures = [
        Figure(_title(fit, values, states, part), caption, _panels(grid, values, part))
        for part in parts
    ]
    half = values.half_band[:, values.inside]
    if half.size and np.isfinite(half).all():
        title = band_title(name, half, values.scale.unit, "recorded states")
        widest = np.minimum(values.half_band, np.quantile(half, 0.95))
        caption = f"Half the width of the 95 % band. {_BAND}"
        bands = replace(values, values=widest, titles=tuple(f"± {one}" for one in values.titles))
        figures += [Figure(title, caption, _panels(grid, bands, part)) for part in parts]
    return figures


def _title(fit: Fit, values: MapValues, states: str, part: slice = _WHOLE) -> str:
    inside = (values.values[part, values.inside] / values.scale.factor).ravel().tolist()
    span = range_text(inside, fit.model.map_units.get(values.name, ""))
    return f"{values.name} over {states}: {span} in the excited region"


def _panels(grid: RegionGrid, values: MapValues, part: slice) -> go.Figure:
    """Return contours of some components side by side."""
    unit, shape = values.scale.unit, grid.supported.shape
    maps = [
        RegionMap(f"<b>{title}</b> in {unit}".removesuffix(" in "), one.reshape(shape), unit)
        for title, one in zip(values.titles[part], values.values[part], strict=True)
    ]
    return region_maps(grid, maps)
