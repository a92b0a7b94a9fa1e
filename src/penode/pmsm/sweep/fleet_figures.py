"""Figures of a fleet: a quantity over dates or recordings, a colour a machine; R over horizons."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
import polars as pl

from penode.arrays import FloatArray
from penode.report import palette, panels
from penode.report.quantities import scale_for, symbol, with_unit

#: A colour and a marker for each machine that is singled out.
_MARKS = (
    (palette.ESTIMATE, "circle"),
    (palette.FREE_RUN, "diamond"),
    (palette.PLATEAU_TEXT, "square"),
    (palette.MARKER_LINE, "triangle-up"),
    (palette.CAUTION, "triangle-down"),
    (palette.REFUSAL, "pentagon"),
)
SINGLED = len(_MARKS)
#: Factor between the horizons at which variants are drawn beside each other.
_BESIDE = 1.06
#: Most points of a figure; of more, evenly spaced ones are drawn.
_MOST = 3000


def over_dates(
    rows: pl.DataFrame, name: str, unit: str, bars: tuple[str, str] | None, singled: Sequence[str]
) -> go.Figure:
    """Draw a quantity over the dates of the recordings, or over the recordings without dates.

    ``bars`` are the columns of the ends of its interval; machines in ``singled`` have a colour of
    their own, all others are grey.
    """
    rows = rows.filter(pl.col(name).is_finite()).gather_every(max(-(-len(rows) // _MOST), 1))
    dated = bool(len(rows)) and not rows["date"].has_nulls()
    scale = scale_for(rows[name].to_numpy(), unit)
    figure = panels.blank_figure()
    groups = [(one, rows.filter(pl.col("machine") == one)) for one in singled[:SINGLED]]
    rest = rows.filter(~pl.col("machine").is_in([one for one, _ in groups]))
    drawn = [(*group, *mark, 8) for group, mark in zip(groups, _MARKS, strict=False)]
    if len(rest) and groups:
        drawn.append(("other machines", rest, palette.OTHER, "circle", 7))
    elif len(rest):
        drawn.append(("recordings", rest, palette.ESTIMATE, "circle", 7))
    for label, group, colour, marker, size in drawn:
        trace = _points(group, label, (name, scale.factor, bars), dated)
        trace.marker.update(color=colour.light, symbol=marker, size=size)
        trace.error_y.color = colour.light
        figure.add_trace(trace)
    title = "date" if dated else "recording, in the order of the table"
    figure.update_layout(
        height=400,
        xaxis_title_text=title,
        yaxis_title_text=f"{symbol(name)} in {scale.unit}",
        showlegend=len(figure.data) > 1,
        hovermode="closest",
    )
    return figure


def _points(
    rows: pl.DataFrame, label: str, drawn: tuple[str, float, tuple[str, str] | None], dated: bool
) -> go.Scatter:
    name, factor, bars = drawn
    values = rows[name].to_numpy() * factor
    x = rows["date"].to_list() if dated else (rows["place"] + 1).to_list()
    trace = go.Scatter(
        x=x,
        y=panels.compact(values),
        mode="markers",
        name=label,
        text=[_told(row, name) for row in rows.iter_rows(named=True)],
        hovertemplate="%{text}<extra></extra>",
    )
    if bars:
        low, high = (rows[bar].to_numpy() * factor for bar in bars)
        trace.error_y = {
            "array": panels.compact(_length(high - values)),
            "arrayminus": panels.compact(_length(values - low)),
            "thickness": 1.2,
            "width": 3,
        }
    return trace


def _length(lengths: FloatArray) -> FloatArray:
    return np.where(np.isfinite(lengths), lengths, 0.0)


def _told(row: dict[str, object], name: str) -> str:
    value = row[name]
    shown = with_unit(
        value if isinstance(value, float) else None, "ohm" if name == "R" else "Vs", 4
    )
    return f"{row['recording']}: {shown}"


def over_horizons(rows: pl.DataFrame) -> go.Figure:
    """Draw R over the horizon (``selected``), a marker an identification, a colour a variant."""
    rows = rows.filter(pl.col("R").is_finite()).gather_every(max(-(-len(rows) // _MOST), 1))
    scale = scale_for(rows["R"].to_numpy(), "ohm")
    figure = panels.blank_figure()
    groups = list(rows.group_by("variant", maintain_order=True))[:SINGLED]
    pairs = zip(groups, _MARKS, strict=False)
    for number, (((variant,), group), (colour, marker)) in enumerate(pairs):
        beside = _BESIDE ** (number - (len(groups) - 1) / 2)
        figure.add_trace(
            go.Scatter(
                x=(group["selected"] * beside).to_list(),
                y=panels.compact(group["R"].to_numpy() * scale.factor),
                mode="markers",
                name=str(variant) or "as the study says",
                marker={"color": colour.light, "symbol": marker, "size": 8},
                text=[f"H = {r['selected']}, {_told(r, 'R')}" for r in group.iter_rows(named=True)],
                hovertemplate="%{text}<extra></extra>",
            )
        )
    ticks = sorted(set(rows["selected"].to_list()))
    figure.update_layout(
        height=400,
        xaxis={
            "type": "log",
            "title": {"text": "horizon H in samples"},
            "tickvals": ticks,
            "ticktext": [str(tick) for tick in ticks],
        },
        yaxis_title_text=f"R in {scale.unit}",
        showlegend=len(figure.data) > 1,
        hovermode="closest",
    )
    return figure
