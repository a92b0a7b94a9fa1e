"""Correlations of the one-step residual with its own past and with the inputs."""

from typing import Any

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray
from penode.report import palette, panels
from penode.report.quantities import number, symbol
from penode.validation.residual_tests import Correlations

#: Lines of the inputs, in order; more inputs begin again.
_COLOURS = (palette.ONE_STEP, palette.FREE_RUN, palette.MARKER_LINE, palette.GOOD, palette.CAUTION)
#: Pixels: height of a panel, space between panels, room for labels of an axis; gap in widths.
_HEIGHT, _BETWEEN, _LABELS, _GAP = 150.0, 30.0, 36.0, 0.12

#: Least correlation of neighbouring one-step errors that noise at either end gives, with a margin.
_NOISE = -0.6


def correlations_title(tests: Correlations) -> str:
    """Say whether the residual is white and unrelated to the inputs."""
    past = "is correlated with its past" if _beyond_own(tests) else "is white"
    if _is_noise(tests):
        past = "is the sensors' noise"
    if not tests.cross.size:
        return f"The residual {past}"
    if not _beyond_cross(tests):
        return f"The residual {past} and unrelated to the inputs"
    relative = np.abs(tests.cross) / np.maximum(tests.cross_limit, 1e-300)
    which = int(np.unravel_index(int(relative.argmax()), relative.shape)[-1])
    largest = number(float(np.abs(tests.cross[..., which]).max()), 2)
    return f"The residual {past} and related to {tests.inputs[which]} (correlation up to {largest})"


def correlations_caption(tests: Correlations) -> str:
    """Say how to read the figure, and what follows for the numbers."""
    text = (
        f"Correlation of the one-step residual of {tests.recording} with itself, and with the "
        "inputs of earlier samples. Bands: 99 % of what white noise, or a residual unrelated to "
        "the input, shows by chance."
    )
    if _starts_from_noise(tests):
        text += (
            " White noise of the sensors alone gives -0.5 at a lag of one sample: a prediction "
            "starts from the noise of the sample before."
        )
    if _beyond_own(tests) and not _is_noise(tests):
        text += (
            " Where it is correlated with its past, textbook deviations are wrong, too small where "
            "that is positive; those given here allow for it."
        )
    if _beyond_cross(tests):
        text += (
            " A relation to an input is a response that the model lacks: a delay, a neglected "
            "effect, or a map that is too stiff."
        )
    return text


def correlations(tests: Correlations) -> go.Figure:
    """Draw autocorrelations and correlations with the inputs over the lag, a row per state."""
    rows = len(tests.states)
    wide = panels.Grid([1.0, 1.0], [_HEIGHT] * rows, _GAP, [_BETWEEN] * (rows - 1))
    apart = [_BETWEEN] * (2 * rows - 2) + [_BETWEEN + _LABELS]
    figure = panels.panelled(wide, panels.Grid([1.0], [_HEIGHT] * 2 * rows, gaps=apart))
    lags = np.arange(len(tests.own))
    for row, state in enumerate(tests.states):
        place = {"row": row + 1, "col": 1}
        past = _style(state, palette.OTHER.light) | {"showlegend": False}
        figure.add_scatter(x=lags[1:], y=tests.own[1:, row], **past, **place)
        _draw_band(figure, tests.own_limit, place)
        panels.panel_title(figure, f"{symbol(state)} with itself", **place)
        place = {"row": row + 1, "col": 2}
        for k, name in enumerate(tests.inputs):
            style = _style(name, _COLOURS[k % len(_COLOURS)].light) | {"showlegend": row == 0}
            figure.add_scatter(x=lags, y=tests.cross[:, row, k], **style, **place)
        if tests.inputs:
            _draw_band(figure, float(tests.cross_limit[row].max()), place)
        panels.panel_title(figure, f"{symbol(state)} with the inputs", **place)
    figure.update_xaxes(nticks=7, range=[0, len(lags) - 1])
    figure.update_xaxes(title_text="lag in samples", row=rows)
    figure.update_yaxes(nticks=5)
    return figure.update_layout(legend={"x": 1.0, "xanchor": "right"}, margin={"t": 44})


def _style(name: str, colour: str) -> dict[str, Any]:
    return {
        "name": symbol(name),
        "legendgroup": name,
        "line": {"color": colour, "width": 1.4},
        "hovertemplate": f"lag %{{x}}: %{{y:.3f}}<extra>{symbol(name)}</extra>",
    }


def _draw_band(figure: go.Figure, limit: float, place: dict[str, Any]) -> None:
    look = {"fillcolor": palette.INTERVAL.light, "line_width": 0, "layer": "below"}
    figure.add_hrect(-limit, limit, **look, **place)


def _beyond_own(tests: Correlations) -> bool:
    """Return whether the residual's autocorrelations are beyond what chance explains."""
    return _often_beyond(tests.own[1:], tests.own_limit)


def _is_noise(tests: Correlations) -> bool:
    """Return whether it is white but for the noise that a prediction's start brings into it."""
    return _starts_from_noise(tests) and not _often_beyond(tests.own[2:], tests.own_limit)


def _starts_from_noise(tests: Correlations) -> bool:
    """Return whether neighbouring errors are as noise of a prediction's start makes them."""
    return bool(tests.own[1].min() > _NOISE and tests.own[1].max() < -tests.own_limit)


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
