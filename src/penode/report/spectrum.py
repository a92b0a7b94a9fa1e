"""The spectrum of what the model leaves over, and the weight of each frequency in the loss."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray
from penode.horizon.loss_weighting import LossWeighting
from penode.report import palette, panels
from penode.report.quantities import (
    labelled,
    number,
    scale_for,
    symbol,
    takes_prefix,
    with_unit,
)
from penode.validation.residual_lines import Line
from penode.validation.residual_tests import Spectrum

_POINTS = 2000
_COLOURS = (palette.ONE_STEP.light, palette.FREE_RUN.light, palette.PLATEAU_TEXT.light)


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
    count = len(states)
    shared = len({unit for _, unit in states}) == 1
    scale = scale_for(spectrum.frequency, "Hz")
    figure = panels.panelled(panels.Grid([1.0], [170.0] * count, gaps=[26.0] * (count - 1)))
    top = float(spectrum.frequency[-1]) * scale.factor
    for row, (name, unit) in enumerate(states, 1):
        amplitude = spectrum.amplitude[:, row - 1]
        chosen = panels.peaks(amplitude, _POINTS)
        figure.add_scatter(
            x=spectrum.frequency[chosen] * scale.factor,
            y=_drawable(amplitude[chosen]),
            line={"color": palette.ONE_STEP.light, "width": 1.2},
            hovertemplate=f"%{{x:.4~g}} {scale.unit}: %{{y:.3~g}}<extra></extra>",
            row=row,
            col=1,
        )
        limits = panels.decades(spectrum.amplitude[1:] if shared else amplitude[1:], 6)
        ticks = [10.0**k for k in range(math.ceil(limits[0]), math.floor(limits[1]) + 1)]
        prefixed = takes_prefix(unit)
        figure.update_yaxes(
            type="log",
            tickvals=ticks,
            ticktext=[with_unit(t, unit, 1) if prefixed else number(t, 1) for t in ticks],
            range=limits,
            title_text=symbol(name) if prefixed else labelled(symbol(name), unit),
            row=row,
        )
    figure.update_xaxes(range=[0.0, top])
    figure.update_xaxes(title_text=f"frequency in {scale.unit}", row=count)
    within = [(f * scale.factor, label) for f, label in lines if 0 < f * scale.factor <= top]
    panels.mark_lines(figure, within, range(1, count + 1), top)
    return figure.update_layout(showlegend=False)


def weighting_figure(
    view: LossWeighting, lines: Sequence[tuple[Line, str]], units: Sequence[str]
) -> go.Figure:
    """Draw the residual's spectrum (SI units, lines named) above the weights over their mean.

    Two panels for each signal, both logarithmic over the frequency; three horizons at most.
    """
    count, scale = len(view.signals), scale_for(view.frequency, "Hz")
    heights, gaps = [190.0, 150.0] * count, [20.0] * (2 * count - 1)
    figure = panels.panelled(panels.Grid([1.0], heights, gaps=gaps))
    limits = [edge * scale.factor for edge in _shown(view, [line for line, _ in lines])]
    frequency = view.frequency * scale.factor
    every = np.arange(0, len(frequency), -(-len(frequency) // _POINTS))
    for signal, (name, unit) in enumerate(zip(view.signals, units, strict=False)):
        above, below = ({"row": 2 * signal + row, "col": 1} for row in (1, 2))
        amplitude = np.sqrt(view.power[:, signal])
        chosen = panels.peaks(amplitude, _POINTS)
        trace = _weighting_curve("residual", palette.MEASURED.light, 1.2)
        trace.update(x=frequency[chosen], y=_drawable(amplitude[chosen]), showlegend=False)
        figure.add_trace(trace, **above)
        relative = _relative(view.weight[:, :, signal])
        for horizon, colour, weight in zip(view.horizons, _COLOURS, relative, strict=False):
            trace = _weighting_curve(f"H = {horizon}", colour, 1.8)
            trace.update(x=frequency[every], y=_drawable(weight[every]), showlegend=signal == 0)
            figure.add_trace(trace, **below)
        title = labelled("residual" if count == 1 else symbol(name), unit)
        log: dict[str, Any] = {"type": "log", "dtick": 1}
        spans = panels.decades(amplitude[chosen], 5), panels.decades(relative, 5)
        figure.update_yaxes(title_text=title, range=spans[0], **log, **above)
        figure.update_yaxes(title_text="weight", range=spans[1], **log, **below)
        own = [(o.frequency * scale.factor, label) for o, label in lines if o.signal == signal]
        panels.mark_lines(figure, own, [2 * signal + 1, 2 * signal + 2], float(np.ptp(limits)))
    figure.update_xaxes(range=limits)
    figure.update_xaxes(title_text=f"frequency in {scale.unit}", row=2 * count)
    # Room above the panels: the legend, and below it the names of lines.
    return figure.update_layout(margin={"t": 56})


def _weighting_curve(name: str, colour: str, width: float) -> go.Scatter:
    line = {"color": colour, "width": width, "simplify": False}
    hover = "%{x:.4~g}: %{y:.3~g}<extra>" + name + "</extra>"
    return go.Scatter(name=name, line=line, hovertemplate=hover)


def _relative(weight: FloatArray) -> FloatArray:
    """Return weights (horizon, frequency) over their mean; zero of a signal the loss ignores."""
    least = np.maximum(1e-12 * np.abs(weight).max(axis=1, keepdims=True), np.finfo(float).tiny)
    return np.asarray(weight / np.maximum(weight.mean(axis=1, keepdims=True), least))


def _drawable(values: FloatArray) -> FloatArray:
    """Return values that a logarithmic axis in single precision can show."""
    return np.maximum(values, np.finfo(np.float32).tiny)


def _shown(view: LossWeighting, lines: Sequence[Line]) -> tuple[float, float]:
    """Return the frequencies drawn at first: those of the lines, or all."""
    low, high = float(view.frequency[0]), float(view.frequency[-1])
    farthest = max((abs(line.frequency) for line in lines), default=0.0)
    reach = 1.3 * farthest if farthest > 0.02 * high else high
    return max(low, -reach), min(high, reach)
