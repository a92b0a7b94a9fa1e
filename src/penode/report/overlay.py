"""Measured states beside their predictions, over the whole recording and in one close-up."""

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray
from penode.report import palette, panels
from penode.report.quantities import symbol
from penode.validation.comparison import Comparison

#: A free run so many times beyond the limits of the whole is cut off in the close-up too.
_FAR = 10.0
_POINTS = 2000
_CLOSE_UP = 200


def overlay(comparison: Comparison) -> go.Figure:
    """Draw measured, one-step and free-run states, and the errors of both predictions.

    Two rows per state (value, error): at the left the whole recording, thinned to its envelope of
    about 2000 points, at the right a close-up of `_CLOSE_UP` samples where the free run errs as on
    the whole.
    """
    figure = panels.blank_figure()
    states = len(comparison.states)
    window = typical_window(comparison, _CLOSE_UP)
    parts = [slice(0, len(comparison.measured))] + ([window] if window else [])
    rows, columns = 2 * states, len(parts)
    heights, gaps = [190.0, 84.0] * states, ([8.0, 30.0] * states)[:-1]
    wide = panels.grid([2.1, 1.0][:columns], heights, 0.22, gaps)
    pile = panels.grid([1.0], heights * columns, 0.0, [*gaps, 62.0, *gaps][: rows * columns - 1])
    by_row = [pile[0][column * rows + row] for row in range(rows) for column in range(columns)]
    panels.place(figure, wide, (by_row, pile[1]))
    for state in range(states):
        for column, part in enumerate(parts):
            panel = 2 * state * columns + column
            _draw_values(figure, comparison, state, part, panel)
            _draw_errors(figure, comparison, state, part, panel + columns)
    _set_axes(figure, comparison, parts)
    if window:
        _mark_window(figure, comparison, window, rows)
    _mark_divergence(figure, comparison, columns)
    figure.update_layout(hovermode="closest", margin={"t": 40, "l": 70})
    return figure


def typical_window(comparison: Comparison, length: int) -> slice | None:
    """Choose the stretch, ``length`` samples, whose free-run error is nearest to that of the whole.

    None where the recording (up to a divergence) is shorter than two stretches.
    """
    errors = np.sum((comparison.free_run - comparison.measured) ** 2, axis=1)
    broken = np.flatnonzero(~np.isfinite(errors))
    count = (int(broken[0]) if broken.size else len(errors)) // length
    if count < 2:
        return None
    stretches = errors[: count * length].reshape(count, length).mean(axis=1)
    chosen = int(np.argmin(np.abs(stretches - np.median(stretches))))
    return slice(chosen * length, (chosen + 1) * length)


def _draw_values(
    figure: go.Figure, comparison: Comparison, state: int, part: slice, panel: int
) -> None:
    curves = (
        ("measured", comparison.measured, palette.MEASURED.light, 3.6, "solid"),
        ("one step ahead", comparison.one_step, palette.ONE_STEP.light, 1.4, "dot"),
        ("free run", comparison.free_run, palette.FREE_RUN.light, 1.5, "solid"),
    )
    for name, values, colour, width, dash in curves:
        trace = _curve(comparison, values[:, state], part, panel)
        trace.update(name=name, legendgroup=name, showlegend=panel == 0)
        trace.line.update(color=colour, width=width, dash=dash)
        figure.add_trace(trace)


def _draw_errors(
    figure: go.Figure, comparison: Comparison, state: int, part: slice, panel: int
) -> None:
    curves = (
        ("free run", comparison.free_run, palette.FREE_RUN.light),
        ("one step ahead", comparison.one_step, palette.ONE_STEP.light),
    )
    for name, values, colour in curves:
        error = values[:, state] - comparison.measured[:, state]
        trace = _curve(comparison, error, part, panel)
        trace.update(name=f"{name}, error", legendgroup=name, showlegend=False)
        trace.line.update(color=colour, width=1.1)
        figure.add_trace(trace)


def _curve(comparison: Comparison, values: FloatArray, part: slice, panel: int) -> go.Scatter:
    chosen = panels.envelope(values[part], _POINTS)
    return go.Scatter(
        x=panels.compact((chosen + part.start) * comparison.time_step),
        y=panels.compact(values[part][chosen]),
        xaxis=panels.axis_id("x", panel),
        yaxis=panels.axis_id("y", panel),
        mode="lines",
        hovertemplate="%{x:.5~g} s: %{y:.4~g}",
    )


def _set_axes(figure: go.Figure, comparison: Comparison, parts: list[slice]) -> None:
    columns, rows = len(parts), 2 * len(comparison.states)
    for row in range(rows):
        state, is_error = divmod(row, 2)
        limits = _limits(comparison, state, bool(is_error))
        name = "error" if is_error else symbol(comparison.states[state])
        for column, part in enumerate(parts):
            panel = row * columns + column
            last = row == rows - 1
            figure.layout[panels.axis_key("x", panel)].update(
                anchor=panels.axis_id("y", panel),
                matches=None if row == 0 else panels.axis_id("x", column),
                range=[part.start * comparison.time_step, (part.stop - 1) * comparison.time_step],
                nticks=4 if column else 8,
                showticklabels=last,
                title_text=_time_title(column) if last else None,
            )
            figure.layout[panels.axis_key("y", panel)].update(
                anchor=panels.axis_id("x", panel),
                range=limits if column == 0 or _beyond(comparison, state, part, limits) else None,
                nticks=4 if is_error else 6,
                zeroline=bool(is_error),
                title_text=f"{name} in {comparison.units[state]}" if column == 0 else None,
            )


def _time_title(column: int) -> str:
    return "time in s, close-up" if column else "time in s"


def _limits(comparison: Comparison, state: int, is_error: bool) -> list[float]:
    """Return limits that a diverging free run cannot take over."""
    measured = comparison.measured[:, state]
    runs = np.stack([comparison.one_step[:, state], comparison.free_run[:, state]])
    if is_error:
        values, centre = runs - measured, 0.0
    else:
        centre = float(measured.max() + measured.min()) / 2
        values = np.concatenate([runs, measured[None]]) - centre
    values = values[np.isfinite(values)]
    values = values if values.size else np.zeros(1)
    usual = 3 * float(np.quantile(np.abs(values), 0.95))
    usual = min(usual, 0.75 * float(np.ptp(measured))) or 1.0
    low, high = (float(np.clip(end, -usual, usual)) for end in (values.min(), values.max()))
    margin = 0.06 * ((high - low) or 1.0)
    return [low - margin + centre, high + margin + centre]


def _beyond(comparison: Comparison, state: int, part: slice, limits: list[float]) -> bool:
    """Return whether a free run leaves the limits so far that nothing else could be seen."""
    run = comparison.free_run[part, state]
    return bool(np.nanmax(np.abs(run), initial=0.0) > _FAR * np.abs(limits).max())


def _mark_window(figure: go.Figure, comparison: Comparison, window: slice, rows: int) -> None:
    for row in range(rows):
        figure.add_shape(
            type="rect",
            xref=panels.axis_id("x", 2 * row),
            yref=f"{panels.axis_id('y', 2 * row)} domain",
            x0=window.start * comparison.time_step,
            x1=window.stop * comparison.time_step,
            y0=0,
            y1=1,
            layer="below",
            line_width=0,
            fillcolor=palette.WINDOW.light,
        )


def _mark_divergence(figure: go.Figure, comparison: Comparison, columns: int) -> None:
    broken = np.flatnonzero(~np.isfinite(comparison.free_run).all(axis=1))
    if not broken.size:
        return
    time = float(broken[0]) * comparison.time_step
    for state in range(len(comparison.states)):
        panel = 2 * state * columns
        where = {"x": time, "xref": panels.axis_id("x", panel)}
        figure.add_shape(
            type="line",
            x0=time,
            x1=time,
            xref=where["xref"],
            y0=0,
            y1=1,
            yref=f"{panels.axis_id('y', panel)} domain",
            line={"color": palette.REFUSAL.light, "width": 1.5, "dash": "dash"},
        )
        figure.add_annotation(
            text="free run diverged",
            **where,
            y=0,
            yref=f"{panels.axis_id('y', panel)} domain",
            xanchor="left",
            yanchor="bottom",
            xshift=4,
            font={"color": palette.REFUSAL.light},
        )
