"""The spectrum of what the model leaves over."""

import math
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray
from penode.report import palette, panels
from penode.report.quantities import number, scale_for, symbol, takes_prefix, with_unit
from penode.validation.residual_tests import Spectrum

_POINTS = 2000


def residual_spectrum(
    spectrum: Spectrum,
    states: Sequence[tuple[str, str]],
    lines: Sequence[tuple[float, str]] = (),
) -> go.Figure:
    """Draw the amplitude spectrum of the one-step residual, one panel per state, on log amplitudes.

    ``states`` are name and SI unit of each column; ``lines`` are frequencies in Hz to mark, with
    labels. Of each stretch of neighbouring frequencies the largest is drawn, so that no line is
    lost.
    """
    figure = panels.blank_figure()
    count = len(states)
    shared = len({unit for _, unit in states}) == 1
    together = _decades(spectrum.amplitude[1:])
    scale = scale_for(spectrum.frequency, "Hz")
    for state in range(count):
        frequency, amplitude = _peaks(spectrum.frequency, spectrum.amplitude[:, state])
        figure.add_trace(
            go.Scatter(
                x=panels.compact(frequency * scale.factor),
                y=panels.compact(amplitude),
                xaxis=panels.axis_id("x", state),
                yaxis=panels.axis_id("y", state),
                line={"color": palette.ONE_STEP.light, "width": 1.2},
                hovertemplate=f"%{{x:.4~g}} {scale.unit}: %{{y:.3~g}}<extra></extra>",
            )
        )
    boxes = panels.grid([1.0], [170.0] * count, 0.0, [26.0] * (count - 1))
    panels.place(figure, boxes, boxes)
    top = float(spectrum.frequency[-1]) * scale.factor
    for state, (name, unit) in enumerate(states):
        bottom = state == count - 1
        limits = together if shared else _decades(spectrum.amplitude[1:, state])
        figure.layout[panels.axis_key("x", state)].update(
            anchor=panels.axis_id("y", state),
            matches=None if state == 0 else "x",
            range=[0.0, top],
            showticklabels=bottom,
            title_text=f"frequency in {scale.unit}" if bottom else None,
        )
        figure.layout[panels.axis_key("y", state)].update(
            anchor=panels.axis_id("x", state),
            type="log",
            tickvals=_ticks(limits),
            ticktext=[_tick(tick, unit) for tick in _ticks(limits)],
            range=limits,
            title_text=symbol(name) if takes_prefix(unit) else f"{symbol(name)} in {unit}",
        )
    _mark_lines(figure, [(f * scale.factor, label) for f, label in lines], top, count)
    figure.update_layout(showlegend=False, hovermode="closest")
    return figure


def _peaks(frequency: FloatArray, amplitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    size = -(-len(amplitude) // _POINTS)
    whole = len(amplitude) // size
    stretches = amplitude[: whole * size].reshape(whole, size)
    chosen = np.arange(whole) * size + stretches.argmax(axis=1)
    floor = np.finfo(np.float32).tiny
    return frequency[chosen], np.maximum(amplitude[chosen], floor)


def _decades(amplitude: FloatArray) -> list[float]:
    visible = amplitude[np.isfinite(amplitude) & (amplitude > 0)]
    if not visible.size:
        return [-1.0, 0.0]
    low, high = np.log10(np.quantile(visible, 0.02)), np.log10(visible.max())
    return [float(max(low, high - 6)) - 0.1, float(high) + 0.25]


def _ticks(limits: Sequence[float]) -> list[float]:
    """Return every decade inside the limits."""
    return [10.0**k for k in range(math.ceil(limits[0]), math.floor(limits[1]) + 1)]


def _tick(value: float, unit: str) -> str:
    return with_unit(value, unit, 1) if takes_prefix(unit) else number(value, 1)


def _mark_lines(
    figure: go.Figure, lines: Sequence[tuple[float, str]], top: float, states: int
) -> None:
    labelled = -np.inf
    for frequency, label in lines:
        if not 0 < frequency <= top:
            continue
        for state in range(states):
            figure.add_shape(
                type="line",
                xref=panels.axis_id("x", state),
                yref=f"{panels.axis_id('y', state)} domain",
                x0=frequency,
                x1=frequency,
                y0=0,
                y1=1,
                layer="below",
                line={"color": palette.MARKER_LINE.light, "width": 1, "dash": "dot"},
            )
        if frequency - labelled >= 0.07 * top:
            labelled = frequency
            figure.add_annotation(
                text=label,
                x=frequency,
                xref="x",
                y=1,
                yref="y domain",
                yanchor="bottom",
                font={"color": palette.MARKER_LINE.light, "size": 12},
            )
