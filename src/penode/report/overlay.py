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
    states = len(comparison.states)
    window = typical_window(comparison, _CLOSE_UP)
    parts = [slice(0, len(comparison.measured))] + ([window] if window else [])
    rows, columns = 2 * states, len(parts)
    heights, gaps = [190.0, 84.0] * states, ([8.0, 30.0] * states)[:-1]
    pile = panels.Grid([1.0], heights * columns, gaps=[*gaps, 62.0, *gaps][: rows * columns - 1])
    by_column = [row * columns + column for column in range(columns) for row in range(rows)]
    figure = panels.panelled(
        panels.Grid([2.1, 1.0][:columns], heights, 0.22, gaps), pile, by_column
    )
    for column, part in enumerate(parts):
        for state in range(states):
            _draw(figure, comparison, state, part, column)
        ends = [part.start * comparison.time_step, (part.stop - 1) * comparison.time_step]
        figure.update_xaxes(range=ends, nticks=4 if column else 8, col=column + 1)
        title = "time in s, close-up" if column else "time in s"
        figure.update_xaxes(title_text=title, row=rows, col=column + 1)
    if window:
        figure.add_vrect(
            window.start * comparison.time_step,
            window.stop * comparison.time_step,
            fillcolor=palette.WINDOW.light,
            line_width=0,
            layer="below",
            row="all",
            col=1,
        )
    _mark_divergence(figure, comparison)
    return figure.update_layout(margin={"t": 40, "l": 70})


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


def _draw(figure: go.Figure, comparison: Comparison, state: int, part: slice, column: int) -> None:
    """Draw a state and, in the row below, the errors of its predictions."""
    measured = comparison.measured[:, state]
    predictions = {
        "one step ahead": (comparison.one_step[:, state], palette.ONE_STEP.light),
        "free run": (comparison.free_run[:, state], palette.FREE_RUN.light),
    }
    name, unit, first = symbol(comparison.states[state]), comparison.units[state], column == 0
    values, errors = ({"row": 2 * state + row, "col": column + 1} for row in (1, 2))
    line = {"color": palette.MEASURED.light, "width": 3.6}
    shown = {"showlegend": first and state == 0}
    figure.add_trace(_curve(comparison, measured, part, "measured", line).update(shown), **values)
    for label, (predicted, colour) in predictions.items():
        dash, width = ("dot", 1.4) if label == "one step ahead" else ("solid", 1.5)
        line = {"color": colour, "width": width, "dash": dash}
        figure.add_trace(_curve(comparison, predicted, part, label, line).update(shown), **values)
    for label, (predicted, colour) in reversed(predictions.items()):
        line = {"color": colour, "width": 1.1}
        error = _curve(comparison, predicted - measured, part, label, line)
        error.update(name=f"{label}, error", showlegend=False)
        figure.add_trace(error, **errors)
    for is_error, place in ((False, values), (True, errors)):
        limits = _limits(comparison, state, is_error)
        figure.update_yaxes(
            range=limits if first or _beyond(comparison, state, part, limits) else None,
            nticks=4 if is_error else 6,
            zeroline=is_error,
            title_text=f"{'error' if is_error else name} in {unit}" if first else None,
            **place,
        )


def _curve(
    comparison: Comparison, values: FloatArray, part: slice, name: str, line: dict[str, object]
) -> go.Scatter:
    chosen = panels.envelope(values[part], _POINTS)
    return go.Scatter(
        x=(chosen + part.start) * comparison.time_step,
        y=values[part][chosen],
        name=name,
        legendgroup=name,
        mode="lines",
        line=line,
        hovertemplate="%{x:.5~g} s: %{y:.4~g}",
    )


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


def _mark_divergence(figure: go.Figure, comparison: Comparison) -> None:
    broken = np.flatnonzero(~np.isfinite(comparison.free_run).all(axis=1))
    if not broken.size:
        return
    time = float(broken[0]) * comparison.time_step
    colour = palette.REFUSAL.light
    for state in range(len(comparison.states)):
        place = {"row": 2 * state + 1, "col": 1}
        figure.add_vline(time, line={"color": colour, "width": 1.5, "dash": "dash"}, **place)
        corner = {"xanchor": "left", "y": 0, "yref": "y domain", "yanchor": "bottom", "xshift": 4}
        figure.add_annotation(
            text="free run diverged", x=time, font={"color": colour}, **corner, **place
        )
