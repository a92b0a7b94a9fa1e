"""Correlations of the one-step residual with its own past and with the inputs."""

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray
from penode.report import palette, panels
from penode.report.quantities import number, symbol
from penode.validation.residual_tests import Correlations

#: Lines of the inputs, in order; more inputs begin again.
_COLOURS = (
    palette.ONE_STEP,
    palette.FREE_RUN,
    palette.MARKER_LINE,
    palette.GOOD,
    palette.CAUTION,
)
#: Pixels: height of a panel, space between panels, room for labels of an axis; gap in widths.
_HEIGHT, _BETWEEN, _LABELS, _GAP = 150.0, 30.0, 36.0, 0.12


def correlations_title(tests: Correlations) -> str:
    """Say whether the residual is white and unrelated to the inputs."""
    past = "is correlated with its past" if _beyond_own(tests) else "is white"
    relative = np.abs(tests.cross) / np.maximum(tests.cross_limit, 1e-300)
    if not relative.size:
        return f"The residual {past}"
    _, _, which = np.unravel_index(int(relative.argmax()), relative.shape)
    name = tests.inputs[int(which)]
    if not _beyond_cross(tests):
        return f"The residual {past} and unrelated to the inputs"
    largest = number(float(np.abs(tests.cross[..., which]).max()), 2)
    return f"The residual {past} and related to {name} (correlation up to {largest})"


def correlations_caption(tests: Correlations) -> str:
    """Say how to read the figure, and what follows for the numbers."""
    text = (
        f"Correlation of the one-step residual of {tests.recording} with itself, and with the "
        "inputs of earlier samples. Bands: 99 % of what white noise, or a residual unrelated to "
        "the input, shows by chance."
    )
    if _beyond_own(tests):
        text += (
            " A residual that is correlated with its past makes textbook deviations too small; "
            "those given here allow for it."
        )
    if _beyond_cross(tests):
        text += (
            " A relation to an input is a response that the model lacks: a delay, a neglected "
            "effect, or a map that is too stiff."
        )
    return text


def correlations(tests: Correlations) -> go.Figure:
    """Draw autocorrelations and correlations with the inputs over the lag, a row per state."""
    figure = panels.blank_figure()
    rows = len(tests.states)
    boxes = panels.grid([1.0, 1.0], [_HEIGHT] * rows, _GAP, [_BETWEEN] * (rows - 1))
    apart = [_BETWEEN] * (2 * rows - 2) + [_BETWEEN + _LABELS]
    piled = panels.grid([1.0], [_HEIGHT] * 2 * rows, 0.0, apart)
    panels.place(figure, boxes, piled)
    lags = np.arange(len(tests.own), dtype=np.float64)
    for row, state in enumerate(tests.states):
        own, cross = 2 * row, 2 * row + 1
        _band(figure, own, lags, tests.own_limit)
        past = _curve(own, lags[1:], tests.own[1:, row], state, palette.OTHER)
        figure.add_trace(past.update(showlegend=False))
        for k, name in enumerate(tests.inputs):
            colour = _COLOURS[k % len(_COLOURS)]
            curve = _curve(cross, lags, tests.cross[:, row, k], name, colour)
            figure.add_trace(curve.update(showlegend=row == 0))
        if tests.inputs:
            _band(figure, cross, lags, float(tests.cross_limit[row].max()))
        for panel, other in ((own, "with itself"), (cross, "with the inputs")):
            _set_axes(figure, panel, f"{symbol(state)} {other}", bottom=row == rows - 1)
    legend = {"x": 1.0, "xanchor": "right"}
    figure.update_layout(hovermode="closest", legend=legend, margin={"t": 44})
    return figure


def _beyond_own(tests: Correlations) -> bool:
    """Return whether the residual's autocorrelations are beyond what chance explains."""
    return _often_beyond(tests.own[1:], tests.own_limit)


def _beyond_cross(tests: Correlations) -> bool:
    """Return whether some input's correlations are beyond what chance explains."""
    return _often_beyond(tests.cross, tests.cross_limit)


def _often_beyond(values: FloatArray, limit: FloatArray | float) -> bool:
    """Return whether a column of values (lag, ...) is beyond its limit at over 5 % of lags.

    One lag beyond twice the limit is enough: white noise is there once in four million lags.
    """
    size = np.abs(values)
    often = bool(size.size) and (size > limit).mean(axis=0).max() > 0.05
    return bool(often or (size > 2 * limit).any())


def _curve(
    panel: int, lags: FloatArray, values: FloatArray, name: str, colour: palette.Colour
) -> go.Scatter:
    return go.Scatter(
        x=panels.compact(lags),
        y=panels.compact(values),
        xaxis=panels.axis_id("x", panel),
        yaxis=panels.axis_id("y", panel),
        name=symbol(name),
        legendgroup=name,
        line={"color": colour.light, "width": 1.4},
        hovertemplate=f"lag %{{x}}: %{{y:.3f}}<extra>{symbol(name)}</extra>",
    )


def _band(figure: go.Figure, panel: int, lags: FloatArray, limit: float) -> None:
    figure.add_shape(
        type="rect",
        xref=panels.axis_id("x", panel),
        yref=panels.axis_id("y", panel),
        x0=float(lags[0]),
        x1=float(lags[-1]),
        y0=-limit,
        y1=limit,
        fillcolor=palette.INTERVAL.light,
        line={"width": 0},
        layer="below",
    )


def _set_axes(figure: go.Figure, panel: int, title: str, *, bottom: bool) -> None:
    x, y = panels.axis_id("x", panel), panels.axis_id("y", panel)
    figure.layout[panels.axis_key("x", panel)].update(
        anchor=y,
        nticks=7,
        showticklabels=bottom,
        title_text="lag in samples" if bottom else None,
    )
    figure.layout[panels.axis_key("y", panel)].update(anchor=x, nticks=5)
    figure.add_annotation(
        text=title,
        x=0,
        xref=f"{x} domain",
        xanchor="left",
        y=1,
        yref=f"{y} domain",
        yanchor="bottom",
        yshift=3,
    )
