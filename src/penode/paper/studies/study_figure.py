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


def study_figure(panels: Sequence[Panel | Matrix]) -> bytes:
    """Draw panels side by side as PNG, legends below the axes."""
    size = (5.5 * len(panels), 4.0)
    figure, row = plt.subplots(1, len(panels), figsize=size, layout="constrained", squeeze=False)
    for axes, panel in zip(row[0], panels, strict=True):
        if isinstance(panel, Matrix):
            _draw_matrix(axes, panel)
        else:
            _draw_panel(axes, panel)
        axes.set(xlabel=panel.x_label, ylabel=panel.y_label)
        axes.set_title(panel.title, loc="left", fontsize=10)
    # Legends are wider than their axes, which the layout would make narrower for them.
    legends = [axes.get_legend() for axes in row[0] if axes.get_legend()]
    for legend in legends:
        legend.set_in_layout(False)
    content = io.BytesIO()
    figure.savefig(
        content,
        format="png",
        dpi=100,
        metadata={"Software": None},
        bbox_inches="tight",
        bbox_extra_artists=legends,
    )
    plt.close(figure)
    return content.getvalue()


def _draw_panel(axes: Axes, panel: Panel) -> None:
    if panel.truth is not None:
        axes.axhline(panel.truth, color=INK, lw=1, ls="--", label="truth")
    for series in panel.series:
        _draw_series(axes, series, panel.y_limits)
    axes.set(xscale="log", yscale="log" if panel.y_log else "linear")
    if panel.y_limits is not None:
        axes.set_ylim(*panel.y_limits)
        if panel.y_limits[0] < 0 < panel.y_limits[1]:
            axes.axhline(0, color="0.8", lw=0.8, zorder=0)
    axes.spines[["top", "right"]].set_visible(False)
    if panel.legend:
        axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(0.0, -0.15))


def _draw_series(axes: Axes, series: Series, limits: tuple[float, float] | None) -> None:
    colour = COLOURS[series.colour]
    x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
    sound = np.isfinite(y)
    low, high = limits or (-np.inf, np.inf)
    inside = sound & (y >= low) & (y <= high)
    if limits is not None:
        for out, edge, arrow in ((~sound | (y > high), high, "^"), (sound & (y < low), low, "v")):
            axes.plot(x[out], np.full(out.sum(), edge), arrow, color=colour, ms=6, clip_on=False)
    if series.marker:
        size = 13 if series.marker == "*" else 5
        axes.plot(x[inside], y[inside], series.marker, color=colour, ms=size, label=series.label)
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


def _number(value: float) -> str:
    if np.isnan(value):
        return "–"
    if np.isinf(value):
        return "diverges"
    return f"{value:.3g}" if value < 1e4 else f"{value:.0e}"
