"""How the loss at each horizon weighs the residual: its lines, and the weight over frequency."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from penode.arrays import FloatArray, IntArray
from penode.fit.fit import Fit
from penode.horizon.loss_weighting import LossWeighting, loss_weighting
from penode.report import palette, panels
from penode.report.document import Cell, Notice, Row, Section, Table
from penode.report.guard import picture
from penode.report.quantities import number, scale_for, symbol, with_unit
from penode.report.weighting_sentence import weighting_sentence
from penode.validation.residual_lines import Line

_POINTS = 1500
#: Lines named at most, and the fraction of the loss at one of the horizons from which one is named.
_NAMED, _WORTH = 8, 1e-3
_TOP = 56  # pixels above the panels: the legend, and below it the names of lines
_TITLE = "How each horizon weighs the residual"
_LEAD = (
    "Training H steps ahead is training one step ahead through a filter: the longer the horizon, "
    "the more weight on what the model can follow, and the less on the rest."
)
_COLOURS = (palette.ONE_STEP.light, palette.FREE_RUN.light, palette.PLATEAU_TEXT.light)
_CAPTION = (
    "Above: one-step residual of the first training recording; of neighbouring frequencies the "
    "largest is drawn. Below: the weight of each frequency in the loss, as a multiple of the mean "
    "over all frequencies. The loss adds up the product of residual and weight."
)


@dataclass(frozen=True)
class Name:
    """What a line is called, and what may have made it; empty where that is not known."""

    line: Line
    label: str
    cause: str = ""


def signal_units(fit: Fit, view: LossWeighting) -> tuple[str, ...]:
    """Return the SI unit of each of the view's signals."""
    units = fit.comparisons[0].units
    return units[: len(view.signals)]


def unnamed(view: LossWeighting) -> tuple[Name, ...]:
    """Return the view's lines called by their frequency."""
    return tuple(Name(line, with_unit(line.frequency, "Hz")) for line in view.lines)


def weighting_of(fit: Fit, base: float | None = None) -> LossWeighting | None:
    """Return how the loss weighs the residual at H = 1, the selected and the longest horizon.

    ``base``, in Hz, is the frequency whose multiples are the lines' orders; its sign is kept. None
    where the fit keeps no one-step matrices or no prediction.
    """
    if not fit.transitions.size or not fit.comparisons:
        return None
    longest = max((rung.horizon for rung in fit.horizon.ladder), default=1)
    horizons = sorted({1, fit.horizon.selected, longest})
    shown = (one for one in fit.comparisons if one.name == fit.spectrum.recording)
    comparison = next(shown, fit.comparisons[0])
    return loss_weighting(comparison, fit.transitions, horizons, base, fit.starts)


def weighting_section(
    view: LossWeighting, names: Sequence[Name], units: Sequence[str], note: str = ""
) -> Section:
    """Say and show how the loss weighs the residual at three horizons at most.

    ``names`` come strongest first; ``units`` is the SI unit of each signal; ``note``, what the
    names mean, goes into the caption. A notice takes the place of all where the weight is available
    at no horizon.
    """
    whole, view = view, view.at(view.available)
    if not view.horizons:
        why = weighting_sentence(whole, [])
        return Section(_TITLE, _LEAD, [Notice("caution", "Not available", why)])
    largest = [float(view.fractions(name.line).max()) for name in names]
    order = sorted(
        (k for k in range(len(names)) if largest[k] >= _WORTH), key=lambda k: -largest[k]
    )
    worth = [names[k] for k in sorted(order[:_NAMED])]
    caption = " ".join(filter(None, [_CAPTION, _peak(view), note]))
    title = "The residual has no lines"
    if worth:
        count = "one line," if len(worth) == 1 else f"{len(worth)} lines, the strongest"
        title = f"The residual has {count} at {worth[0].label}"
    return Section(
        _TITLE,
        f"{_LEAD} {weighting_sentence(whole, [(name.line, name.label) for name in worth])}",
        [
            picture(title, caption, weighting_figure, view, worth, units),
            *_table(view, worth, units),
        ],
    )


def _peak(view: LossWeighting) -> str:
    """Say where the weight of the longest horizon peaks; at H = 1 it is flat."""
    longest = int(np.argmax(view.horizons))
    if view.horizons[longest] == 1:
        return ""
    peak = with_unit(float(view.frequency[view.weight[longest, :, 0].argmax()]), "Hz")
    return f"The weight of a long horizon peaks at {peak}, where errors grow most over the horizon."


def weighting_figure(view: LossWeighting, names: Sequence[Name], units: Sequence[str]) -> go.Figure:
    """Draw the residual's spectrum (SI units, lines named) above the weights over their mean.

    Two panels for each signal, both logarithmic over the frequency; three horizons at most.
    """
    figure, scale = panels.blank_figure(), scale_for(view.frequency, "Hz")
    count = len(view.signals)
    boxes = panels.grid([1.0], [190.0, 150.0] * count, 0.0, [20.0] * (2 * count - 1))
    panels.place(figure, boxes, boxes)
    limits = [edge * scale.factor for edge in _shown(view, names)]
    for signal in range(count):
        _draw(figure, view, (signal, units[signal]), scale.factor)
        own = [name for name in names if name.line.signal == signal]
        _mark(figure, own, signal, scale.factor, float(np.ptp(limits)))
    for panel in range(2 * count):
        bottom = panel == 2 * count - 1
        figure.layout[panels.axis_key("x", panel)].update(
            anchor=panels.axis_id("y", panel),
            matches=None if panel == 0 else "x",
            range=limits,
            showticklabels=bottom,
            title_text=f"frequency in {scale.unit}" if bottom else None,
        )
    figure.update_layout(hovermode="closest", margin={"t": _TOP})
    return figure


def _draw(figure: go.Figure, view: LossWeighting, column: tuple[int, str], factor: float) -> None:
    signal, unit = column
    amplitude = np.sqrt(view.power[:, signal])
    weight = view.weight[:, :, signal]  # zero of a signal that the loss does not see
    least = np.maximum(1e-12 * np.abs(weight).max(axis=1, keepdims=True), np.finfo(float).tiny)
    relative = weight / np.maximum(weight.mean(axis=1, keepdims=True), least)
    drawn = np.arange(0, len(view.frequency), max(len(view.frequency) // _POINTS, 1))
    curves = [(2 * signal, "residual", palette.MEASURED.light, _largest(amplitude), amplitude)]
    for horizon, colour, weight in zip(view.horizons, _COLOURS, relative, strict=False):
        curves.append((2 * signal + 1, f"H = {horizon}", colour, drawn, weight))
    for panel, name, colour, at, values in curves:
        figure.add_trace(
            go.Scatter(
                x=panels.compact(view.frequency[at] * factor),
                y=panels.compact(np.maximum(values[at], np.finfo(np.float32).tiny)),
                xaxis=panels.axis_id("x", panel),
                yaxis=panels.axis_id("y", panel),
                name=name,
                showlegend=signal == 0 and name != "residual",
                line={
                    "color": colour,
                    "width": 1.2 if name == "residual" else 1.8,
                    "simplify": False,
                },
                hovertemplate="%{x:.4~g}: %{y:.3~g}<extra>" + name + "</extra>",
            )
        )
    name = "residual" if len(view.signals) == 1 else symbol(view.signals[signal])
    titles = (f"{name} in {unit}" if unit else name, "weight")
    spans = (_decades(amplitude[_largest(amplitude)]), _decades(relative))
    for panel, title, span in zip((2 * signal, 2 * signal + 1), titles, spans, strict=True):
        figure.layout[panels.axis_key("y", panel)].update(
            anchor=panels.axis_id("x", panel), type="log", range=span, dtick=1, title_text=title
        )


def _mark(
    figure: go.Figure, names: Sequence[Name], signal: int, factor: float, width: float
) -> None:
    """Mark lines through both panels of a signal, and label those with room for it."""
    labelled: list[float] = []
    for name in names:
        at = name.line.frequency * factor
        for panel in (2 * signal, 2 * signal + 1):
            figure.add_shape(
                type="line",
                xref=panels.axis_id("x", panel),
                yref=f"{panels.axis_id('y', panel)} domain",
                x0=at,
                x1=at,
                y0=0,
                y1=1,
                layer="below",
                line={"color": palette.MARKER_LINE.light, "width": 1, "dash": "dot"},
            )
        if all(abs(at - other) >= 0.09 * width for other in labelled):
            labelled.append(at)
            figure.add_annotation(
                text=name.label,
                x=at,
                xref=panels.axis_id("x", 2 * signal),
                y=1,
                yref=f"{panels.axis_id('y', 2 * signal)} domain",
                yanchor="bottom",
                font={"color": palette.MARKER_LINE.light, "size": 12},
            )


def _table(view: LossWeighting, names: Sequence[Name], units: Sequence[str]) -> list[Table]:
    if not names:
        return []
    shared = len(set(units)) == 1 and units[0]
    columns = (
        "line",
        "frequency in\N{NO-BREAK SPACE}Hz",
        f"amplitude in\N{NO-BREAK SPACE}{units[0]}" if shared else "amplitude",
        *(f"fraction at H\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}{h}" for h in view.horizons),
        *(["likely causes"] if any(name.cause for name in names) else []),
    )
    rows = []
    for name in names:
        line = name.line
        own = "" if shared else f"\N{NO-BREAK SPACE}{units[line.signal]}".rstrip()
        cells = [
            Cell(name.label),
            Cell(number(line.frequency, 4), line.frequency, "number"),
            Cell(f"{number(line.amplitude)}{own}", line.amplitude, "number"),
        ]
        for fraction in view.fractions(line).tolist():
            cells.append(Cell(f"{number(100 * fraction, 2)} %", fraction, "number"))
        rows.append(Row((*cells, *([Cell(name.cause)] if len(columns) > len(cells) else []))))
    caption = "Fraction of the loss at each horizon; the rest lies between the lines."
    return [Table("Lines of the one-step residual", columns, tuple(rows), caption)]


def _largest(values: FloatArray) -> IntArray:
    """Return the index of the largest value of each stretch."""
    size = -(-len(values) // _POINTS)
    whole = len(values) // size
    stretches = values[: whole * size].reshape(whole, size)
    return np.asarray(np.arange(whole) * size + stretches.argmax(axis=1))


def _shown(view: LossWeighting, names: Sequence[Name]) -> tuple[float, float]:
    """Return the frequencies drawn at first: those of the lines, or all."""
    low, high = float(view.frequency[0]), float(view.frequency[-1])
    farthest = max((abs(name.line.frequency) for name in names), default=0.0)
    reach = 1.3 * farthest if farthest > 0.02 * high else high
    return max(low, -reach), min(high, reach)


def _decades(values: FloatArray) -> list[float]:
    visible = values[np.isfinite(values) & (values > 0)]
    if not visible.size:
        return [-1.0, 0.0]
    low, high = np.log10(np.quantile(visible, 0.02)), np.log10(visible.max())
    return [float(max(low, high - 5)) - 0.1, float(high) + 0.2]
