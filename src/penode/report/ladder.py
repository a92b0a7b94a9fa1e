"""A parameter's estimate over the ladder of horizons."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray, IntArray
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.report import palette, panels
from penode.report.quantities import Scale, labelled, scale_for, symbol, with_deviation

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

    def groups(self) -> list[tuple[str, str, BoolArray]]:
        """Return label, colour and rungs of each kind of estimate, those without rungs left out."""
        selected = self.horizons == self.selected
        agreeing = np.isin(self.horizons, self.plateau) & ~selected
        named = [
            ("other horizons", palette.OTHER.light, ~selected & ~agreeing),
            ("horizons that agree", palette.ESTIMATE.light, agreeing),
            (f"selected, H = {self.selected}", palette.FREE_RUN.light, selected),
        ]
        return [one for one in named if one[2].any()]

    def text(self, rung: int) -> str:
        """Return an estimate with its half width in words."""
        shown = " ± ".join(with_deviation(self.values[rung], self.bars[rung]))
        return f"H = {self.horizons[rung]}: {shown} {self.scale.unit}"


def parameter_over_ladder(fit: Fit, name: str) -> go.Figure:
    """Draw a parameter's estimate, with 1.96 deviations, over the horizon in steps (logarithmic).

    The plateau is shaded, and enlarged beside it where all horizons together hide it; the selected
    horizon and the reported 95 % interval are marked.
    """
    ladder = _Ladder.of(fit, name)
    views = ladder.views()
    figure = panels.panelled(
        panels.Grid([1.7, 1.0][: len(views)], [330.0], 0.24),
        panels.Grid([1.0], [270.0] * len(views), gaps=[66.0] * (len(views) - 1)),
    )
    for panel, shown in enumerate(views):
        _shade(figure, ladder, panel)
        _draw_estimates(figure, ladder, panel)
        _set_axes(figure, ladder, panel, shown)
    figure.layout.yaxis.title.text = labelled(symbol(name), ladder.scale.unit)
    figure.layout.yaxis.automargin = True  # a narrow plateau takes labels of many digits
    if len(views) > 1:
        figure.layout.xaxis2.title.text = "H, plateau enlarged"
    return figure


def _shade(figure: go.Figure, ladder: _Ladder, panel: int) -> None:
    """Shade interval and plateau, with an entry of the legend each."""
    place: dict[str, Any] = {"row": 1, "col": panel + 1}
    look = {"line_width": 0, "layer": "below", "exclude_empty_subplots": False} | place
    areas = []
    if np.isfinite(ladder.interval).all():
        areas.append(("95 % interval shown by the data", palette.INTERVAL.light))
        figure.add_hrect(*ladder.interval, fillcolor=palette.INTERVAL.light, **look)
    if ladder.plateau:
        areas.append(("plateau", palette.PLATEAU.light))
        ends = min(ladder.plateau) / 1.1, max(ladder.plateau) * 1.1
        figure.add_vrect(*ends, fillcolor=palette.PLATEAU.light, **look)
    for label, colour in areas if panel == 0 else ():
        marker = {"symbol": "square", "size": 12, "color": colour}
        entry = {"name": label, "hoverinfo": "skip", "mode": "markers"}
        figure.add_scatter(x=[None], y=[None], marker=marker, **entry, **place)


def _draw_estimates(figure: go.Figure, ladder: _Ladder, panel: int) -> None:
    for label, colour, chosen in ladder.groups():
        figure.add_scatter(
            x=ladder.horizons[chosen],
            y=ladder.values[chosen],
            error_y={"array": ladder.bars[chosen], "thickness": 1.6, "width": 4, "color": colour},
            mode="markers",
            marker={"color": colour, "size": 8},
            text=[ladder.text(int(rung)) for rung in np.flatnonzero(chosen)],
            hovertemplate="%{text}<extra></extra>",
            name=label,
            legendgroup=label,
            showlegend=panel == 0,
            row=1,
            col=panel + 1,
        )
    figure.data[-1].marker.update(size=12, symbol="diamond")


def _set_axes(figure: go.Figure, ladder: _Ladder, panel: int, shown: BoolArray) -> None:
    horizons, place = ladder.horizons[shown], {"row": 1, "col": panel + 1}
    low, high = int(horizons.min()), int(horizons.max())
    steps = [step * 10**decade for decade in range(len(str(high)) + 1) for step in (1, 2, 5)]
    ticks = [tick for tick in steps if low / 1.2 <= tick <= high * 1.2]
    ends = [np.log10(low / 1.2), np.log10(high * 1.2)]
    title = "horizon H in samples"
    figure.update_xaxes(type="log", title_text=title, tickvals=ticks, range=ends, **place)
    figure.update_yaxes(range=ladder.limits(shown), **place)
