"""Figures of a fit: the ladder, the predictions, a learned map. Imported when one is drawn."""

import inspect
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from penode.arrays import BoolArray, FloatArray
from penode.errors import InputError
from penode.fit.outcome import NORMAL_95
from penode.validation.comparison import Comparison

if TYPE_CHECKING:
    from penode.fit.fit import Fit

__all__ = ["Figure", "draw_ladder", "draw_map", "draw_predictions"]

_INK, _MUTED, _GREY = "#18212d", "#566376", "#b3bdca"
_BLUE, _ORANGE, _GREEN = "#1d62cc", "#d4540a", "#13694e"
_POINTS, _CELLS = 400, 81


def draw_ladder(fit: "Fit") -> Figure:
    """Return the figure of every physical parameter over the horizon; refuse one with none."""
    ladder, names = fit.horizon.ladder, list(fit.parameters)
    if not ladder or not names:
        raise InputError(
            "a ladder is drawn of at least one horizon and one physical parameter, got "
            f"{len(ladder)} and {len(names)}."
        )
    figure, panels = _panels(len(names), 2.6)
    horizons = [rung.horizon for rung in ladder]
    for axes, name in zip(panels, names, strict=True):
        estimate = fit.parameters[name]
        values = [rung.parameters[name] for rung in ladder]
        bars = NORMAL_95 * _finite(np.array([rung.std[name] for rung in ladder]))
        axes.axhspan(*estimate.interval_95, color=_BLUE, alpha=0.15, lw=0, label="reported, 95 %")
        colours = [_GREEN if h in fit.horizon.plateau else _GREY for h in horizons]
        axes.errorbar(horizons, values, bars, fmt="none", ecolor=_MUTED, capsize=2)
        axes.scatter(horizons, values, c=colours, s=18, zorder=3)
        axes.axvline(fit.horizon.selected, color=_INK, lw=0.8, ls="--", label="selected")
        axes.set(xscale="log", ylabel=f"{name} ({estimate.unit})")
    panels[0].scatter([], [], c=_GREEN, s=18, label="agrees with the selected")
    panels[0].legend(frameon=False, fontsize=8)
    panels[-1].set_xlabel("horizon H (samples)")
    panels[-1].set_xticks(horizons, [str(h) for h in horizons], fontsize=8)
    panels[-1].minorticks_off()
    return _titled(figure, f"H = {fit.horizon.selected}, {fit.horizon.verdict}")


def draw_predictions(comparison: Comparison) -> Figure:
    """Return the figure of one recording, measured and predicted, with the errors below."""
    figure, panels = _panels(2 * len(comparison.states), 1.9)
    time = comparison.time_step * np.arange(len(comparison.measured))
    columns = (comparison.measured, comparison.one_step, comparison.free_run)
    for k, (name, unit) in enumerate(zip(comparison.states, comparison.units, strict=True)):
        above, below = panels[2 * k : 2 * k + 2]
        measured, one_step, free_run = (_finite(values[:, k]) for values in columns)
        above.plot(time, measured, color=_GREY, lw=2.5, label="measured")
        above.plot(time, free_run, color=_ORANGE, lw=0.8, label="free run")
        above.set_ylabel(f"{name} ({unit})")
        _limit(above, measured)
        below.plot(time, measured - free_run, color=_ORANGE, lw=0.8, label="free run")
        below.plot(time, measured - one_step, color=_BLUE, lw=0.8, label="one step")
        below.set_ylabel(f"error of {name} ({unit})")
        _limit(below, measured - measured.mean())
    panels[0].legend(frameon=False, fontsize=8, ncols=2)
    panels[1].legend(frameon=False, fontsize=8, ncols=2)
    panels[-1].set_xlabel("time (s)")
    return _titled(figure, f"{comparison.name} ({comparison.role})")


def draw_map(fit: "Fit", name: str, ranges: Mapping[str, tuple[float, float]]) -> Figure:
    """Return the figure of a learned map of one or two arguments; refuse any other.

    ``ranges`` are the lowest and highest value of an argument; those called like a state have the
    excited range.
    """
    maps = fit.model.maps()
    name = name or next(iter(maps), "")
    function = maps.get(name)
    if function is None:
        raise InputError(f"the map must be one of {sorted(maps)}, got {name!r}.")
    arguments = list(inspect.signature(function).parameters)
    if not 1 <= len(arguments) <= 2:
        raise InputError(
            f"maps of one or two arguments are drawn, got {name} with {len(arguments)}."
        )
    spans = [_span(fit, argument, ranges) for argument in arguments]
    unit = fit.model.map_units.get(name, "")
    if len(arguments) == 1:
        return _curve(fit, (name, unit), arguments[0], spans[0])
    return _contours(fit, (name, unit), arguments, spans)


def _curve(fit: "Fit", named: tuple[str, str], argument: str, span: tuple[float, float]) -> Figure:
    x = np.linspace(*span, _POINTS)
    values = np.asarray(getattr(fit, named[0])(x)).reshape(-1, len(x))
    inside = _inside(fit, [argument], x[None])
    figure, panels = _panels(len(values), 3.0)
    for k, (axes, curve) in enumerate(zip(panels, values, strict=True)):
        axes.plot(x, curve, color=_BLUE, lw=1, ls="--", label="extrapolated")
        axes.plot(x, np.where(inside, curve, np.nan), color=_BLUE, lw=2, label="excited region")
        axes.set_ylabel(_label(named, (k,) if len(values) > 1 else ()))
    panels[0].legend(frameon=False, fontsize=8)
    panels[-1].set_xlabel(_argument(fit, argument))
    return _titled(figure, f"{named[0]} of the {type(fit.model).__name__}")


def _contours(
    fit: "Fit",
    named: tuple[str, str],
    arguments: Sequence[str],
    spans: Sequence[tuple[float, float]],
) -> Figure:
    x, y = np.meshgrid(*(np.linspace(*span, _CELLS) for span in spans))
    values = np.asarray(getattr(fit, named[0])(x, y))
    outputs = [(index, values[index]) for index in np.ndindex(values.shape[:-2])]
    inside = _inside(fit, arguments, np.stack([x.ravel(), y.ravel()])).reshape(x.shape)
    columns = min(len(outputs), 2)
    rows = -(-len(outputs) // columns)
    figure = Figure(figsize=(5.0 * columns, 4.0 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (index, output) in zip(panels, outputs, strict=False):
        levels = axes.contourf(x, y, np.where(inside, output, np.nan), levels=14, cmap="viridis")
        figure.colorbar(levels, ax=axes, label=_label(named, index))
        axes.set(xlabel=_argument(fit, arguments[0]), ylabel=_argument(fit, arguments[1]))
    for axes in panels[len(outputs) :]:
        axes.remove()
    return _titled(figure, f"{named[0]} of the {type(fit.model).__name__} in the excited region")


def _span(
    fit: "Fit", argument: str, ranges: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    if argument in ranges:
        low, high = ranges[argument]
        return float(low), float(high)
    if argument not in fit.model.states:
        raise InputError(
            f"the map's argument {argument!r} is no state of {list(fit.model.states)}; "
            f"give its range, {argument}=(low, high)."
        )
    column = fit.excited[:, fit.model.states.index(argument)]
    return float(column.min()), float(column.max())


def _inside(fit: "Fit", arguments: Sequence[str], points: FloatArray) -> BoolArray:
    """Return which points (argument, point) are excited; all where arguments are not the states."""
    if sorted(arguments) == sorted(fit.model.states):
        order = [arguments.index(state) for state in fit.model.states]
        return fit.supported(points[order].T)
    inside = np.ones(points.shape[1], dtype=bool)
    for row, argument in zip(points, arguments, strict=True):
        if argument in fit.model.states:
            low, high = _span(fit, argument, {})
            inside &= (row >= low) & (row <= high)
    return inside


def _argument(fit: "Fit", name: str) -> str:
    units = dict(zip(fit.model.states, fit.model.state_units, strict=True))
    return f"{name} ({units[name]})" if name in units else name


def _label(named: tuple[str, str], index: tuple[int, ...]) -> str:
    name, unit = named
    place = f"[{', '.join(map(str, index))}]" if index else ""
    return f"{name}{place}" + (f" ({unit})" if unit else "")


def _panels(count: int, height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels above each other over one axis."""
    figure = Figure(figsize=(7.0, 0.8 + height * count), layout="constrained")
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels


def _titled(figure: Figure, title: str) -> Figure:
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _limit(axes: Axes, values: Any) -> None:
    """Limit an axis to what was measured, half as much again: a diverged run leaves the figure."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    margin = 0.25 * (high - low) or 1.0
    axes.set_ylim(max(axes.get_ylim()[0], low - margin), min(axes.get_ylim()[1], high + margin))
