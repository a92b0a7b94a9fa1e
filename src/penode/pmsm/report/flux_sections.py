"""The report's sections on a machine's maps: flux linkage, its uncertainty, inductances."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.pmsm.report.flux_slices import flux_slices
from penode.pmsm.report.inductance_table import inductance_table
from penode.report import palette, panels
from penode.report.document import Figure, Notice, Section, attempt, missing, picture
from penode.report.learned_maps import OUTLINE, band_figures, region_grid
from penode.report.region_map import RegionGrid, region_maps
from penode.report.statements import range_text

_CONTOUR_POINTS = 121
_SURFACE_POINTS = 81
_BISECTIONS = 8
#: The four nearest neighbours of a grid point, then the diagonal ones.
_NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_CURRENTS = ("i<sub>d</sub>", "i<sub>q</sub>")
_FLUX = ("<b>ψ<sub>d</sub></b>", "<b>ψ<sub>q</sub></b>")
#: Entries of the differential inductance that are drawn, with their names.
_INDUCTANCES = {"dd": (0, 0), "dq": (0, 1), "qq": (1, 1)}


def flux_linkage(fit: Fit) -> Section:
    """Return the section on the flux-linkage map and its band."""
    psi = _supported(fit, fit.flux_map(*fit.excited.T))
    spans = [range_text(values, "Vs") for values in psi]
    return Section(
        "Flux-linkage map",
        "How much flux the windings link at each pair of currents, averaged over the rotor's "
        "angle. Straight and evenly spaced contours would mean a linear machine; where they "
        "bend or draw apart, the iron saturates.",
        [
            picture(
                f"Flux linkage of {spans[0]} in the d axis and {spans[1]} in the q axis",
                OUTLINE.format("currents"),
                flux_map_contours,
                fit,
            ),
            picture(
                "The same map in perspective",
                "Drawn where the recordings support it. Drag, or use the arrow keys, to turn it.",
                flux_map_surfaces,
                fit,
            ),
            *_bands(fit),
            *flux_slices(fit),
        ],
    )


def _bands(fit: Fit) -> list[Figure | Notice]:
    grid = current_grid(fit, _CONTOUR_POINTS)
    points = np.stack(grid.mesh, axis=-1).reshape(-1, 2)
    half = 1e3 * NORMAL_95 * fit.learned_deviation(points).T.reshape(2, *grid.supported.shape)
    titles = [f"{title}, ± mVs" for title in _FLUX]
    return band_figures("The map", grid, half, titles, "mVs", "currents")


def inductances(fit: Fit) -> Section:
    """Return the section on inductances, differential over the currents and both at a few."""
    inductance = _supported(fit, fit.differential_inductance(*fit.excited.T))
    d_axis, cross, q_axis = (
        range_text(inductance[entry], "H") for entry in ((0, 0), (0, 1), (1, 1))
    )
    return Section(
        "Inductances",
        "The slope of the flux-linkage map: what a current controller or a position observer "
        "meets at each operating point. The cross-coupling is zero in a linear machine.",
        [
            picture(
                f"d axis {d_axis}, q axis {q_axis}, cross-coupling {cross}",
                OUTLINE.format("currents"),
                differential_inductances,
                fit,
            ),
            attempt("the table of inductances", partial(inductance_table, fit), missing),
        ],
    )


def _supported(fit: Fit, values: FloatArray) -> FloatArray:
    """Return map values (..., sample) at the recorded currents in the excited region."""
    chosen = values[..., fit.supported(fit.excited)]
    return chosen if chosen.shape[-1] else values


def current_grid(fit: Fit, points: int) -> RegionGrid:
    """Return a grid, ``points`` per axis, around the recorded currents, i_d and i_q in A."""
    return region_grid(fit, (0, 1), points)


def flux_map_contours(fit: Fit) -> go.Figure:
    """Draw contours of psi_d and psi_q, mVs, over the currents, grey outside the excited region."""
    grid = current_grid(fit, _CONTOUR_POINTS)
    psi = fit.flux_map(*grid.mesh) * 1e3
    return region_maps(grid, [f"{title} in mVs" for title in _FLUX], psi, "mVs")


def differential_inductances(fit: Fit) -> go.Figure:
    """Draw contours of L_dd, L_dq and L_qq, µH, grey outside the excited region."""
    grid = current_grid(fit, _CONTOUR_POINTS)
    inductance = fit.differential_inductance(*grid.mesh) * 1e6
    titles = [f"<b>L<sub>{name}</sub></b> in µH" for name in _INDUCTANCES]
    drawn = np.stack([inductance[at] for at in _INDUCTANCES.values()])
    return region_maps(grid, titles, drawn, "µH")


def flux_map_surfaces(fit: Fit) -> go.Figure:
    """Draw psi_d and psi_q in mVs as surfaces over the currents, inside the excited region."""
    i_d, i_q, inside = _trimmed(fit, current_grid(fit, _SURFACE_POINTS))
    psi = np.where(inside, fit.flux_map(i_d, i_q) * 1e3, np.nan)
    figure, steps = panels.blank_figure(), len(palette.SURFACE) - 1
    x, y = _CURRENTS
    look = {
        "xaxis": {"title": {"text": f"{x} in A"}, "nticks": 5},
        "yaxis": {"title": {"text": f"{y} in A"}, "nticks": 5},
        "zaxis": {"title": {"text": ""}, "nticks": 6},
        "camera": {"eye": {"x": -1.35, "y": -1.6, "z": 0.95}, "center": {"z": -0.12}},
        "aspectmode": "manual",
        "aspectratio": {"x": 1, "y": 1, "z": 0.78},
    }
    for scene, name, height in zip(
        ("scene", "scene2"), ("ψ<sub>d</sub>", "ψ<sub>q</sub>"), psi, strict=True
    ):
        figure.add_surface(
            x=i_d,
            y=i_q,
            z=height,
            scene=scene,
            colorscale=[[k / steps, colour] for k, colour in enumerate(palette.SURFACE)],
            showscale=False,
            contours={"z": {"show": True, "color": "rgba(255,255,255,0.45)", "width": 1}},
            lighting={"ambient": 0.72, "diffuse": 0.5, "specular": 0.06, "roughness": 0.9},
            hovertemplate=f"{x} %{{x:.4~g}} A, {y} %{{y:.4~g}} A<br>{name} %{{z:.4~g}} mVs"
            "<extra></extra>",
        )
        figure.layout[scene] = look
    return figure.update_layout(
        **_scenes([([0, 0.49], [0, 1]), ([0.51, 1], [0, 1])], 440),
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        meta={"narrow": _scenes([([0, 1], [0.51, 1]), ([0, 1], [0, 0.49])], 780)},
    )


def _scenes(domains: Sequence[tuple[list[float], list[float]]], height: int) -> dict[str, Any]:
    """Return the layout entries that say where the two scenes and their titles lie."""
    place = {"xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "top"}
    layout: dict[str, Any] = {"annotations": [], "height": height}
    for scene, title, (x, y) in zip(("scene", "scene2"), _FLUX, domains, strict=True):
        layout[scene] = {"domain": {"x": x, "y": y}}
        text = {"text": f"{title} in mVs", "font": {"size": 14}}
        layout["annotations"].append({"x": x[0], "y": y[1], **text, **place})
    return layout


def _trimmed(fit: Fit, grid: RegionGrid) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Move the grid points just outside the excited region onto its boundary.

    A surface that ended at whole grid cells would have a torn edge.
    """
    mesh = np.stack(grid.mesh, axis=-1)
    inner, reached = mesh.copy(), grid.supported.copy()
    for shift in _NEIGHBOURS:
        neighbour = _shifted(grid.supported, shift)
        new = neighbour & ~reached
        inner[new] = _shifted(mesh, shift)[new]
        reached |= new
    edge = reached & ~grid.supported
    near, far = inner[edge], mesh[edge]
    for _ in range(_BISECTIONS):
        middle = (near + far) / 2
        within = np.asarray(fit.supported(middle))[:, None]
        near, far = np.where(within, middle, near), np.where(within, far, middle)
    mesh[edge] = near
    return mesh[..., 0], mesh[..., 1], reached


def _shifted(values: Any, shift: tuple[int, int]) -> Any:
    """Return each grid point's neighbour; the grid must not be supported at its rim."""
    return np.roll(values, shift, axis=(0, 1))
