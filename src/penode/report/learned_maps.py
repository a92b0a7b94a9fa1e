"""Learned maps of any model over the states: curves of one state, contours over two."""

import inspect
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray, float64
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.models.parameters import with_batch_axis
from penode.report import palette, panels
from penode.report.document import Figure
from penode.report.quantities import Scale, number, scale_for, symbol
from penode.report.region_map import RegionGrid, RegionMap, region_maps
from penode.report.statements import listed, range_text
from penode.validation.coverage import supported

_CURVE_POINTS, _GRID_POINTS = 241, 81
#: Space around the excited region, as a fraction of its width.
_MARGIN = 0.08
#: Contour panels side by side.
_BESIDE = 2
_BAND = (
    "It allows for residuals that are correlated in time and for the spread over the horizons that "
    "agree, and it holds if the model's structure is right."
)


@dataclass(frozen=True, eq=False)
class MapValues:
    """A learned map at points of the states it depends on.

    Attributes
    ----------
    name : str
        The map.
    titles : tuple of str
        Markup of each component.
    values : ndarray, shape (component, point)
        In the unit of ``scale``.
    half_band : ndarray, shape (component, point)
        Half the width of the 95 % band, in the same unit; nan where there is none.
    inside : ndarray of bool, shape (point,)
        Which points lie in the excited region.
    scale : Scale
        From the SI unit of the map to the unit shown.
    """

    name: str
    titles: tuple[str, ...]
    values: FloatArray
    half_band: FloatArray
    inside: BoolArray
    scale: Scale


def map_columns(fit: Fit, name: str) -> tuple[int, ...] | None:
    """Return the states that a learned map is a function of, by the names of its arguments.

    Parameters
    ----------
    fit : Fit
        Identification result.
    name : str
        One of ``fit.model.maps()``.

    Returns
    -------
    tuple of int or None
        Columns of ``fit.excited``. None where an argument is no state, unless there are as many
        arguments as states: they then have the order of the states.
    """
    states = fit.model.states
    try:
        signature = inspect.signature(fit.model.maps()[name])
    except ValueError:  # written in C
        return None
    required = [one.name for one in signature.parameters.values() if one.default is one.empty]
    if set(required) <= set(states):
        return tuple(states.index(argument) for argument in required)
    return tuple(range(len(states))) if len(required) == len(states) else None


def map_figures(fit: Fit, name: str) -> list[Figure]:
    """Draw a learned map with its 95 % band where the fit has one.

    Parameters
    ----------
    fit : Fit
        Identification result.
    name : str
        One of ``fit.model.maps()``.

    Returns
    -------
    list of Figure
        Curves over one state, contours over two; empty where the map depends on something else.
    """
    columns = map_columns(fit, name) or ()
    drawn = {1: _curves, 2: _contours}.get(len(columns))
    return drawn(fit, name, columns) if drawn else []


def region_grid(fit: Fit, columns: tuple[int, int], points: int) -> RegionGrid:
    """Return a grid around the excited region of two states.

    Parameters
    ----------
    fit : Fit
        Identification result.
    columns : (int, int)
        States along x and y.
    points : int
        Grid points per axis.

    Returns
    -------
    RegionGrid
        With a margin, the same along both axes where the states share a unit.
    """
    names, units = (
        (one[columns[0]], one[columns[1]]) for one in (fit.model.states, fit.model.state_units)
    )
    excited = fit.excited[:, list(columns)]
    low, high = excited.min(axis=0), excited.max(axis=0)
    margin = _MARGIN * np.maximum(high - low, 1e-9)
    margin = np.full(2, margin.max()) if units[0] == units[1] else margin
    x, y = (np.linspace(a - m, b + m, points) for a, b, m in zip(low, high, margin, strict=True))
    mesh = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = fit.supported(mesh) if len(fit.model.states) == 2 else supported(excited, mesh)
    markup = (symbol(names[0]), symbol(names[1]))
    return RegionGrid(x, y, np.reshape(inside, (points, points)), excited, markup, units)


def band_title(name: str, half: FloatArray, unit: str, over: str) -> str:
    """Say how narrow a band is.

    Parameters
    ----------
    name : str
        What is known.
    half : ndarray, shape (point, ...)
        Half the width of the band inside the excited region, in ``unit``; finite.
    unit : str
        Unit.
    over : str
        What the points are, such as ``"recorded currents"``.

    Returns
    -------
    str
        Title of the figure.
    """
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
    margin = _MARGIN * max(float(np.ptp(recorded)), 1e-9)
    axis = np.linspace(recorded.min() - margin, recorded.max() + margin, _CURVE_POINTS)
    values = _evaluate(fit, name, columns, axis[:, None])
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
    known = np.isfinite(half) & values.inside
    if known.any():
        ends = np.concatenate([curve[known] - half[known], (curve[known] + half[known])[::-1]])
        figure.add_trace(
            go.Scatter(
                x=panels.compact(np.concatenate([axis[known], axis[known][::-1]])),
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
    values = _evaluate(fit, name, columns, mesh)
    states = listed([fit.model.states[column] for column in columns])
    unit = values.scale.unit
    title = _title(fit, values, states)
    caption = (
        "Inside the dashed outline lie the recorded states (dots). Outside it, greyed, the map is "
        "an extrapolation."
    )
    figures = [Figure(title, caption, plot) for plot in _maps(grid, values, values.values, "in")]
    half = values.half_band[:, values.inside]
    if half.size and np.isfinite(half).all():
        title = band_title(name, half, unit, "recorded states")
        clipped = np.minimum(values.half_band, np.quantile(half, 0.95))
        caption = f"Half the width of the 95 % band. {_BAND}"
        figures += [Figure(title, caption, plot) for plot in _maps(grid, values, clipped, "±")]
    return figures


def _title(fit: Fit, values: MapValues, states: str) -> str:
    inside = (values.values[:, values.inside] / values.scale.factor).ravel().tolist()
    span = range_text(inside, fit.model.map_units.get(values.name, ""))
    return f"{values.name} over {states}: {span} in the excited region"


def _maps(grid: RegionGrid, values: MapValues, drawn: FloatArray, sign: str) -> list[go.Figure]:
    """Return contour figures of all components, a few panels each."""
    unit = values.scale.unit
    maps = [
        RegionMap(f"<b>{title}</b> {sign} {unit}".rstrip(), one.reshape(grid.supported.shape), unit)
        for title, one in zip(values.titles, drawn, strict=True)
    ]
    return [region_maps(grid, maps[k : k + _BESIDE]) for k in range(0, len(maps), _BESIDE)]


def _evaluate(fit: Fit, name: str, columns: tuple[int, ...], points: FloatArray) -> MapValues:
    """Return a map at points (point, argument) of some states, the others at their medians."""
    values = np.asarray(getattr(fit, name)(*points.T), dtype=np.float64)
    shape = values.shape[:-1]
    values = np.broadcast_to(values, (*shape, len(points))).reshape(-1, len(points))
    states = np.tile(np.median(fit.excited, axis=0), (len(points), 1))
    states[:, list(columns)] = points
    scale = scale_for(values, fit.model.map_units.get(name, ""))
    titles = [symbol(name) + "".join(f"[{k}]" for k in index) for index in np.ndindex(shape)]
    return MapValues(
        name,
        tuple(titles),
        values * scale.factor,
        NORMAL_95 * scale.factor * _deviation(fit, states, values),
        supported(fit.excited[:, list(columns)], points),
        scale,
    )


def _deviation(fit: Fit, states: FloatArray, values: FloatArray) -> FloatArray:
    """Return the deviation of each component that is an output of ``learned``, else nan."""
    with float64():
        model = with_batch_axis(fit.model)
        outputs = np.asarray(model.learned(jnp.asarray(states.T)))
    deviation = np.full(values.shape, np.nan)
    if not len(outputs):
        return deviation
    of_learned = fit.learned_deviation(states).T
    for row, value in enumerate(values):
        for output, known in zip(outputs, of_learned, strict=True):
            if np.allclose(value, output, rtol=1e-6, atol=1e-9 * float(np.abs(output).max())):
                deviation[row] = known
    return np.where(np.isfinite(deviation), deviation, np.nan)
