"""Learned maps of any model over the states: curves of one state, contours over two."""

import inspect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray, float64, on_device
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.models.parameters import with_batch_axis
from penode.report import palette, panels
from penode.report.document import Figure, Notice, picture
from penode.report.quantities import Scale, labelled, number, scale_for, symbol
from penode.report.region_map import RegionGrid, region_maps
from penode.report.statements import listed, range_text
from penode.validation.coverage import supported

_CURVE_POINTS, _GRID_POINTS = 241, 81
#: Contour panels side by side.
_BESIDE = 2
#: Space around the excited region, as a fraction of its width.
_MARGIN = 0.08
#: How to read a map's outline, of recorded states or currents.
OUTLINE = (
    "Inside the dashed outline lie the recorded {} (dots). Outside it and in outlined holes, "
    "greyed, the map is an extrapolation that no recording supports."
)
_BAND = (
    "It allows for what the uncertainty budget lists, for residuals that are correlated in time "
    "and for the spread over the horizons that agree; it holds if the model's structure is right."
)


@dataclass(frozen=True, eq=False)
class MapValues:
    """A learned map (component, point), in the unit of ``scale``, at points of its states.

    ``half_band`` is half the width of the 95 % band, nan where there is none; ``inside`` (point,)
    are the points in the excited region; ``titles`` is the markup of each component.
    """

    name: str
    titles: tuple[str, ...]
    values: FloatArray
    half_band: FloatArray
    inside: BoolArray
    scale: Scale


def map_figures(fit: Fit, name: str) -> list[Figure | Notice]:
    """Draw a learned map, with its 95 % band where the fit has one: curves or contours.

    Empty where the map depends on something other than one or two states.
    """
    columns = map_columns(fit, name) or ()
    drawn = {1: _curves, 2: _contours}.get(len(columns))
    return drawn(fit, name, columns) if drawn else []


def band_figures(
    name: str, grid: RegionGrid, half: FloatArray, titles: Sequence[str], unit: str, over: str
) -> list[Figure | Notice]:
    """Draw half the width (component, row, column) of a map's 95 % band, as contours.

    None where it is not known of all of the excited region.
    """
    inside = half[:, grid.supported].max(axis=0, initial=0.0)
    if not inside.size or not np.isfinite(inside).all():
        return []
    most, nearly_all = np.quantile(inside, [0.5, 0.95]).tolist()
    space = "\N{NO-BREAK SPACE}" if unit else ""
    title = (
        f"{name} is known to ±{number(most, 2)}{space}{unit} over half of the area of the "
        f"recorded {over}, to ±{number(nearly_all, 2)}{space}{unit} over 95 % of it"
    )
    of_several = "; at each point the component known less counts" if len(titles) > 1 else ""
    caption = (
        f"Half the width of the 95 % band; the title's shares are of the area{of_several}. Colours "
        f"stop at the value that 95 % of the area stays below. {_BAND}"
    )
    drawn = _beside(grid, titles, np.minimum(half, nearly_all), unit)
    return [picture(title, caption, region_maps, *shown) for _, *shown in drawn]


def _curves(fit: Fit, name: str, columns: tuple[int, ...]) -> list[Figure | Notice]:
    (column,) = columns
    state, unit = fit.model.states[column], fit.model.state_units[column]
    recorded = fit.excited[:, column]
    margin = _MARGIN * max(float(np.ptp(recorded)), 1e-9)
    axis = np.linspace(recorded.min() - margin, recorded.max() + margin, _CURVE_POINTS)
    values = map_values(fit, name, columns, axis[:, None])
    count = len(values.values)
    heights = [300.0 if count == 1 else 190.0] * count
    figure = panels.panelled(panels.Grid([1.0], heights, gaps=[34.0] * (count - 1)))
    for panel in range(count):
        _draw_curve(figure, values, axis, panel)
    figure.update_xaxes(title_text=labelled(symbol(state), unit), row=count)
    figure.update_layout(margin={"t": 40})
    caption = (
        f"Solid where {state} was recorded, dotted outside, where the map is an extrapolation. "
    )
    has_band = np.isfinite(values.half_band[:, values.inside]).any()
    caption += f"Shaded: the 95 % band. {_BAND}" if has_band else "The fit has no band of this map."
    return [Figure(_title(fit, values, state, slice(count)), caption, figure)]


def _draw_curve(figure: go.Figure, values: MapValues, axis: FloatArray, panel: int) -> None:
    curve, half, unit = values.values[panel], values.half_band[panel], values.scale.unit
    place = {"row": panel + 1, "col": 1, "showlegend": panel == 0, "mode": "lines"}
    finite = np.isfinite(half) & values.inside
    if finite.any():
        low, high = (curve - half)[finite], (curve + half)[finite]
        figure.add_scatter(
            x=np.concatenate([axis[finite], axis[finite][::-1]]),
            y=np.concatenate([low, high[::-1]]),
            line={"width": 0},
            fill="toself",
            fillcolor=palette.INTERVAL.light,
            name="95 % band",
            hoverinfo="skip",
            **place,
        )
    for label, shown, dash in (
        ("recorded", values.inside, "solid"),
        ("extrapolated", ~values.inside, "dot"),
    ):
        figure.add_scatter(
            x=axis,
            y=np.where(shown, curve, np.nan),
            line={"color": palette.ESTIMATE.light, "width": 2, "dash": dash},
            name=label,
            hovertemplate=f"%{{x:.4~g}}: %{{y:.4~g}} {unit}<extra></extra>",
            **place,
        )
    figure.update_yaxes(title_text=labelled(values.titles[panel], unit), row=panel + 1)


def _contours(fit: Fit, name: str, columns: tuple[int, ...]) -> list[Figure | Notice]:
    grid = region_grid(fit, (columns[0], columns[1]), _GRID_POINTS)
    values = map_values(fit, name, columns, np.stack(grid.mesh, axis=-1).reshape(-1, 2))
    states = listed([fit.model.states[column] for column in columns])
    unit, shape = values.scale.unit, (-1, *grid.supported.shape)
    maps, half = values.values.reshape(shape), values.half_band.reshape(shape)
    titles, bands = (
        [labelled(f"<b>{sign}{one}</b>", unit) for one in values.titles] for sign in ("", "± ")
    )
    figures = [
        picture(_title(fit, values, states, part), OUTLINE.format("states"), region_maps, *shown)
        for part, *shown in _beside(grid, titles, maps, unit)
    ]
    return [*figures, *band_figures(name, grid, half, bands, unit, "states")]


def _beside(
    grid: RegionGrid, titles: Sequence[str], maps: FloatArray, unit: str
) -> list[tuple[slice, RegionGrid, Sequence[str], FloatArray, str]]:
    """Return, with what `region_maps` takes, the components that are drawn beside each other."""
    parts = [slice(k, k + _BESIDE) for k in range(0, len(maps), _BESIDE)]
    return [(part, grid, titles[part], maps[part], unit) for part in parts]


def _title(fit: Fit, values: MapValues, states: str, part: slice) -> str:
    inside = (values.values[part, values.inside] / values.scale.factor).ravel().tolist()
    span = range_text(inside, fit.model.map_units.get(values.name, ""))
    return f"{values.name} over {states}: {span} in the excited region"


def map_columns(fit: Fit, name: str) -> tuple[int, ...] | None:
    """Return the columns of ``fit.excited`` that a learned map depends on, by argument names.

    None where an argument is no state, unless there are as many arguments as states: they then have
    the order of the states.
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


def region_grid(fit: Fit, columns: tuple[int, int], points: int) -> RegionGrid:
    """Return a grid, ``points`` per axis, around the excited region of two states, with a margin.

    The margin is the same along both axes where the states share a unit.
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


def map_values(fit: Fit, name: str, columns: tuple[int, ...], points: FloatArray) -> MapValues:
    """Evaluate a learned map at points (point, argument), SI units, of the states in ``columns``.

    There is a band where the component is an output of the model's ``learned``; it holds for the
    other states at their medians.
    """
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
        outputs = np.asarray(model.learned(on_device(states.T)))
    deviation = np.full(values.shape, np.nan)
    if not len(outputs):
        return deviation
    of_learned = fit.learned_deviation(states).T
    for row, value in enumerate(values):
        for output, output_deviation in zip(outputs, of_learned, strict=True):
            if np.allclose(value, output, rtol=1e-6, atol=1e-9 * float(np.abs(output).max())):
                deviation[row] = output_deviation
    return np.where(np.isfinite(deviation), deviation, np.nan)
