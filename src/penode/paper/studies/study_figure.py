"""Figures of the studies."""

import io
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from penode.paper.studies.panels import Matrix, Panel, Series

INK = "#222831"
COLOURS = {
    "paper": "#c8553d",
    "second_order": "#e0a458",
    "jittered": "#8f6c4e",
    "coenergy": "#1768ac",
    "inverter": "#2a9d8f",
    "harmonics": "#6a4c93",
    "ours": "#111d4a",
    "other": "#7a8794",
    "faint": "#b9c2cb",
}


#: Inches of the axes of a panel.
_WIDTH, _HEIGHT = 4.5, 3.1
#: Inches above and below the axes, to their right, and of a line of a legend.
_ABOVE, _BELOW, _RIGHT, _LINE = 0.35, 0.6, 0.15, 0.18


def study_figure(panels: Sequence[Panel | Matrix]) -> bytes:
    """Draw panels side by side as PNG, legends below the axes."""
    legend = _LINE * max(map(_legend_lines, panels))
    lefts = [_left(panel) for panel in panels]
    width = sum(lefts) + (_WIDTH + _RIGHT) * len(panels)
    height = _ABOVE + _HEIGHT + _BELOW + legend
    figure, x = plt.figure(figsize=(width, height)), 0.0
    for panel, left in zip(panels, lefts, strict=True):
        x += left
        place = (x / width, (_BELOW + legend) / height, _WIDTH / width, _HEIGHT / height)
        axes = figure.add_axes(place)
        if isinstance(panel, Matrix):
            _draw_matrix(axes, panel)
        else:
            _draw_panel(axes, panel)
        x += _WIDTH + _RIGHT
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=100, metadata={"Software": None})
    plt.close(figure)
    return content.getvalue()


def _left(panel: Panel | Matrix) -> float:
    """Return the inches that labels take to the left of the axes."""
    longest = max(map(len, panel.rows), default=0) if isinstance(panel, Matrix) else 0
    return 0.85 + 0.055 * longest


def _legend_lines(panel: Panel | Matrix) -> int:
    if isinstance(panel, Matrix) or not panel.legend:
        return 0
    return sum(bool(series.label) for series in panel.series) + (panel.truth is not None)


def _draw_panel(axes: Axes, panel: Panel) -> None:
    if panel.truth is not None:
        axes.axhline(panel.truth, color=INK, lw=1, ls="--", label="truth")
    for series in panel.series:
        _draw_series(axes, series, panel.y_limits)
    if panel.x_log:
        axes.set_xscale("log")
    if panel.y_log:
        axes.set_yscale("log")
    if panel.y_limits is not None:
        axes.set_ylim(*panel.y_limits)
        if panel.y_limits[0] < 0 < panel.y_limits[1]:
            axes.axhline(0, color="0.8", lw=0.8, zorder=0)
    axes.set(xlabel=panel.x_label, ylabel=panel.y_label)
    axes.set_title(panel.title, loc="left", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    if panel.legend:
        place = (0.0, -_BELOW / _HEIGHT)
        axes.legend(
            frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=place, borderaxespad=0.0
        )


def _draw_series(axes: Axes, series: Series, limits: tuple[float, float] | None) -> None:
    colour = COLOURS[series.colour]
    x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
    sound = np.isfinite(y)
    beyond = np.zeros(len(y), dtype=bool)
    if limits is not None:
        low, high = limits
        beyond = ~sound | (y < low) | (y > high)
        for above, arrow in ((True, "^"), (False, "v")):
            out = beyond & ((y > high) | ~sound if above else y < low)
            edge = high if above else low
            axes.plot(x[out], np.full(out.sum(), edge), arrow, color=colour, ms=6, clip_on=False)
    inside = sound & ~beyond
    if series.marker:
        size = 13 if series.marker == "*" else 5
        axes.plot(x[inside], y[inside], series.marker, color=colour, ms=size, label=series.label)
    if series.joined and sound.any():
        places = np.unique(x[sound])
        means = [float(np.mean(y[sound & (x == place)])) for place in places]
        label = None if series.marker else series.label
        axes.plot(places, means, color=colour, lw=1.2, alpha=0.7, label=label)


def _draw_matrix(axes: Axes, matrix: Matrix) -> None:
    values = np.asarray(matrix.values, dtype=float)
    shade = np.log10(np.where(np.isfinite(values) & (values > 0), values, np.nan))
    axes.imshow(shade, cmap="Blues", aspect="auto", alpha=0.75)
    dark = np.nanmin(shade) + 0.6 * np.ptp(shade[np.isfinite(shade)])
    for row, column in np.ndindex(*values.shape):
        colour = "white" if shade[row, column] > dark else INK
        text = _number(float(values[row, column]))
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(matrix.columns)), matrix.columns, fontsize=7)
    axes.set_yticks(range(len(matrix.rows)), matrix.rows, fontsize=8)
    axes.set(xlabel=matrix.x_label, ylabel=matrix.y_label)
    axes.set_title(matrix.title, loc="left", fontsize=10)


def _number(value: float) -> str:
    if np.isnan(value):
        return "–"
    if np.isinf(value):
        return "diverges"
    return f"{value:.3g}" if value < 1e4 else f"{value:.0e}"
