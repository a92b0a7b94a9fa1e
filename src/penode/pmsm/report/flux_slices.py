"""Slices through the flux-linkage map: psi of one axis over its current, with the 95 % band."""

import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.report import palette, panels
from penode.report.document import Figure, Notice, picture
from penode.report.region_map import nice_levels

_POINTS, _SLICES = 61, 4
_COLOURS = tuple(
    role.light
    for role in (palette.ONE_STEP, palette.FREE_RUN, palette.PLATEAU_TEXT, palette.MARKER_LINE)
)
_Q = 1
#: The other current of a slice lies within this share of what was recorded, from the middle.
_WITHIN = 0.9


def flux_slices(fit: Fit) -> list[Figure | Notice]:
    """Draw psi_d over i_d at a few i_q, and psi_q over i_q at a few i_d."""
    caption = (
        "Each line is one value of the current in the other axis; where lines lie apart, the axes "
        "saturate each other. Solid where recordings have been, dotted outside. Shaded: the "
        "95 % band, mostly thinner than a line."
    )
    return [
        picture(f"ψ_{one} over i_{one}, at several i_{other}", caption, flux_slice, fit, axis)
        for axis, one, other in ((0, "d", "q"), (1, "q", "d"))
    ]


def slice_currents(fit: Fit, axis: int) -> FloatArray:
    """Return the currents (slice, point, 2), A, of slices along an axis, 0 for d and 1 for q."""
    low, high = fit.excited.min(axis=0), fit.excited.max(axis=0)
    other = 1 - axis
    middle, half = (low[other] + high[other]) / 2, (high[other] - low[other]) / 2
    ends = middle + _WITHIN * half * np.array([-1.0, 1.0])
    if other == _Q:
        # psi_d is the same for both signs of i_q but for what is odd in the machine.
        ends = np.array([0.0, ends[1]]) if high[_Q] >= -low[_Q] else np.array([ends[0], 0.0])
    levels = nice_levels(ends, _SLICES - 1)
    levels = levels[(levels >= ends[0]) & (levels <= ends[1])]
    levels = levels[np.linspace(0, len(levels) - 1, min(len(levels), _SLICES)).round().astype(int)]
    points = np.empty((len(levels), _POINTS, 2))
    points[..., axis] = np.linspace(low[axis], high[axis], _POINTS)
    points[..., other] = levels[:, None]
    return points


def _band(
    current: FloatArray, low: FloatArray, high: FloatArray, known: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the outlines of a band (point,), one of each stretch where it is known."""
    outlines = []
    edges = np.flatnonzero(np.diff(known.astype(int), prepend=0, append=0)).reshape(-1, 2)
    for first, end in edges:
        part = slice(first, end)
        there = np.stack([current[part], low[part]])
        back = np.stack([current[part], high[part]])[:, ::-1]
        outlines += [there, back, np.full((2, 1), np.nan)]
    x, y = np.concatenate(outlines or [np.empty((2, 0))], axis=1)
    return x, y


def flux_slice(fit: Fit, axis: int) -> go.Figure:
    """Draw psi of an axis, mVs, over its current at several currents of the other, with band."""
    points = slice_currents(fit, axis)
    flat = points.reshape(-1, 2)
    psi = 1e3 * fit.flux_map(*flat.T)[axis].reshape(points.shape[:2])
    half = 1e3 * NORMAL_95 * fit.learned_deviation(flat)[:, axis].reshape(points.shape[:2])
    inside = np.reshape(fit.supported(flat), points.shape[:2])
    figure = panels.panelled(panels.Grid([1.0], [330.0]))
    one, other = "dq"[axis], "dq"[1 - axis]
    for k, colour in enumerate(_COLOURS[: len(points)]):
        current, value = points[k, :, axis], points[k, 0, 1 - axis]
        label = f"i<sub>{other}</sub> = {value + 0.0:g} A".replace("-", "−")
        known = np.isfinite(half[k]) & inside[k]
        x, y = _band(current, psi[k] - half[k], psi[k] + half[k], known)
        figure.add_scatter(
            x=x,
            y=y,
            line={"width": 0},
            fill="toself",
            fillcolor=palette.INTERVAL.light,
            legendgroup=label,
            showlegend=False,
            hoverinfo="skip",
        )
        for dash, y in (("dot", psi[k]), ("solid", np.where(inside[k], psi[k], np.nan))):
            figure.add_scatter(
                x=current,
                y=y,
                mode="lines",
                name=label,
                legendgroup=label,
                showlegend=dash == "solid",
                line={"color": colour, "width": 1.8, "dash": dash},
                hovertemplate="%{x:.4~g} A: %{y:.4~g} mVs",
            )
    figure.update_xaxes(title_text=f"i<sub>{one}</sub> in A")
    figure.update_yaxes(title_text=f"ψ<sub>{one}</sub> in mVs")
    return figure.update_layout(margin={"t": 58})
