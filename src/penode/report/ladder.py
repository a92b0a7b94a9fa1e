"""A parameter's estimate over the ladder of horizons."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray, IntArray
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.report import palette, panels
from penode.report.quantities import Scale, decimals_for, fixed, scale_for, symbol

#: A close-up of the plateau is drawn where it enlarges at least this much.
_ENLARGEMENT = 3.0


@dataclass(frozen=True, eq=False)
class _Ladder:
    """What is drawn, in the unit shown."""

    horizons: IntArray
    values: FloatArray
    bars: FloatArray
    selected: int
    plateau: tuple[int, ...]
    interval: FloatArray
    scale: Scale

    @classmethod
    def of(cls, fit: Fit, name: str) -> "_Ladder":
        choice, estimate = fit.horizon, fit.parameters[name]
        rungs = [rung for rung in choice.ladder if name in rung.parameters]
        values = np.array([rung.parameters[name] for rung in rungs], dtype=np.float64)
        std = np.array([rung.std.get(name, np.nan) for rung in rungs], dtype=np.float64)
        scale = scale_for([*values, estimate.value], estimate.unit)
        return cls(
            np.array([rung.horizon for rung in rungs], dtype=np.int64),
            values * scale.factor,
            NORMAL_95 * np.where(np.isfinite(std), std, 0.0) * scale.factor,
            choice.selected,
            choice.plateau if choice.answered and len(choice.plateau) > 1 else (),
            np.array(estimate.statistical_interval_95) * scale.factor,
            scale,
        )

    def limits(self, shown: BoolArray) -> tuple[float, float]:
        """Return limits of the value that hold the rungs shown, and bars that do not dwarf them."""
        levels = np.concatenate([self.values[shown], self.interval])
        levels = levels[np.isfinite(levels)]
        if not levels.size:
            return -1.0, 1.0
        spread = float(np.ptp(levels)) or abs(float(levels[0])) or 1.0
        bars = np.minimum(self.bars[shown], spread)
        ends = np.concatenate([levels, self.values[shown] - bars, self.values[shown] + bars])
        low, high = float(np.nanmin(ends)), float(np.nanmax(ends))
        return low - 0.08 * (high - low), high + 0.08 * (high - low)

    def views(self) -> list[BoolArray]:
        """Return the rungs of each panel: all, and those of the plateau where that enlarges."""
        everything = np.ones(len(self.horizons), dtype=np.bool_)
        close = np.isin(self.horizons, self.plateau)
        if close.sum() < 2:
            return [everything]
        gain = np.ptp(self.limits(everything)) / np.ptp(self.limits(close))
        return [everything, close] if gain >= _ENLARGEMENT else [everything]


def parameter_over_ladder(fit: Fit, name: str) -> go.Figure:
    """Draw a parameter's estimate, with 1.96 deviations, over the horizon in steps (logarithmic).

    The plateau is shaded, and enlarged beside it where all horizons together hide it; the selected
    horizon and the reported 95 % interval are marked.
    """
    ladder = _Ladder.of(fit, name)
    figure = panels.blank_figure()
    views = ladder.views()
    wide = panels.grid([1.7, 1.0][: len(views)], [330.0], 0.24, [])
    narrow = panels.grid([1.0], [270.0] * len(views), 0.0, [66.0] * (len(views) - 1))
    panels.place(figure, wide, narrow)
    for panel, shown in enumerate(views):
        _draw(figure, ladder, panel)
        _set_axes(figure, ladder, panel, shown)
    figure.layout.yaxis.title.text = f"{symbol(name)} in {ladder.scale.unit}".removesuffix(" in ")
    if len(views) > 1:
        figure.layout.xaxis2.title.text = "H, plateau enlarged"
    figure.update_layout(hovermode="closest")
    return figure


def _draw(figure: go.Figure, ladder: _Ladder, panel: int) -> None:
    x, y = panels.axis_id("x", panel), panels.axis_id("y", panel)
    if np.isfinite(ladder.interval).all():
        low, high = ladder.interval
        band = {"x0": 0, "x1": 1, "xref": f"{x} domain", "y0": low, "y1": high, "yref": y}
        figure.add_shape(**band, fillcolor=palette.INTERVAL.light, line_width=0, layer="below")
        figure.add_trace(_swatch("95 % interval shown by the data", palette.INTERVAL.light, panel))
    if ladder.plateau:
        low, high = min(ladder.plateau) / 1.1, max(ladder.plateau) * 1.1
        area = {"x0": low, "x1": high, "xref": x, "y0": 0, "y1": 1, "yref": f"{y} domain"}
        figure.add_shape(**area, fillcolor=palette.PLATEAU.light, line_width=0, layer="below")
        figure.add_trace(_swatch("plateau", palette.PLATEAU.light, panel))
    selected = ladder.horizons == ladder.selected
    agreeing = np.isin(ladder.horizons, ladder.plateau) & ~selected
    groups = (
        ("other horizons", palette.OTHER.light, ~selected & ~agreeing),
        ("horizons that agree", palette.ESTIMATE.light, agreeing),
        (f"selected, H = {ladder.selected}", palette.FREE_RUN.light, selected),
    )
    for label, colour, chosen in groups:
        if chosen.any():
            trace = _estimates(ladder, chosen, colour)
            trace.update(name=label, legendgroup=label, showlegend=panel == 0, xaxis=x, yaxis=y)
            figure.add_trace(trace)
    figure.data[-1].marker.update(size=12, symbol="diamond")


def _set_axes(figure: go.Figure, ladder: _Ladder, panel: int, shown: BoolArray) -> None:
    horizons = ladder.horizons[shown]
    ticks = _ticks(int(horizons.min()), int(horizons.max()))
    figure.layout[panels.axis_key("x", panel)].update(
        anchor=panels.axis_id("y", panel),
        type="log",
        title_text="horizon H in samples",
        tickvals=ticks,
        ticktext=[str(tick) for tick in ticks],
        range=[np.log10(horizons.min() / 1.2), np.log10(horizons.max() * 1.2)],
    )
    figure.layout[panels.axis_key("y", panel)].update(
        anchor=panels.axis_id("x", panel), range=ladder.limits(shown)
    )


def _swatch(label: str, colour: str, panel: int) -> go.Scatter:
    """Return a legend entry for a shaded area."""
    marker = {"symbol": "square", "size": 12, "color": colour}
    entry = {"name": label, "showlegend": panel == 0, "hoverinfo": "skip"}
    return go.Scatter(x=[None], y=[None], mode="markers", marker=marker, **entry)


def _estimates(ladder: _Ladder, chosen: BoolArray, colour: str) -> go.Scatter:
    horizons, values, bars = (
        array[chosen] for array in (ladder.horizons, ladder.values, ladder.bars)
    )
    texts = [
        f"H = {horizon}: {_interval(value, bar)} {ladder.scale.unit}"
        for horizon, value, bar in zip(horizons, values, bars, strict=True)
    ]
    return go.Scatter(
        x=horizons,
        y=values,
        error_y={"array": bars, "thickness": 1.6, "width": 4, "color": colour},
        mode="markers",
        marker={"color": colour, "size": 8},
        text=texts,
        hovertemplate="%{text}<extra></extra>",
    )


def _interval(value: float, bar: float) -> str:
    decimals = decimals_for(bar, value)
    return f"{fixed(value, decimals)} ± {fixed(bar, decimals)}"


def _ticks(low: int, high: int) -> Sequence[int]:
    decades = range(len(str(high)) + 1)
    ticks = [step * 10**decade for decade in decades for step in (1, 2, 5)]
    return [tick for tick in ticks if low / 1.2 <= tick <= high * 1.2]
