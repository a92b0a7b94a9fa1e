"""Pictures of a machine's flux-linkage map and of its differential inductances."""

from typing import Any

import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.report import palette, panels
from penode.report.map_values import region_grid
from penode.report.region_map import RegionGrid, RegionMap, region_maps

_CONTOUR_POINTS = 121
_SURFACE_POINTS = 81
_BAND_POINTS = 41
_BISECTIONS = 8
#: The four nearest neighbours of a grid point, then the diagonal ones.
_NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_AXES = ("d", "q")
_CURRENTS = ("i<sub>d</sub>", "i<sub>q</sub>")


def current_grid(fit: Fit, points: int) -> RegionGrid:
    """Return a grid, ``points`` per axis, around the recorded currents, i_d and i_q in A."""
    return region_grid(fit, (0, 1), points)


def flux_map_contours(fit: Fit) -> go.Figure:
    """Draw contours of psi_d and psi_q, mVs, over the currents, grey outside the excited region."""
    grid = current_grid(fit, _CONTOUR_POINTS)
    psi = fit.flux_map(*grid.mesh) * 1e3
    maps = [
        RegionMap(f"<b>ψ<sub>{axis}</sub></b> in mVs", values, "mVs")
        for axis, values in zip(_AXES, psi, strict=True)
    ]
    return region_maps(grid, maps)


def band_widths(fit: Fit) -> tuple[RegionGrid, FloatArray]:
    """Return half the 95 % band of psi_d and psi_q over the currents, (row, column, 2), in mVs.

    Infinite where the recordings are too short to determine it.
    """
    grid = current_grid(fit, _BAND_POINTS)
    points = np.stack(grid.mesh, axis=-1)
    return grid, 1e3 * NORMAL_95 * fit.learned_deviation(points.reshape(-1, 2)).reshape(
        points.shape
    )


def flux_map_bands(grid: RegionGrid, half: FloatArray) -> go.Figure:
    """Draw what `band_widths` returns, in mVs, grey outside the excited region."""
    maps = [
        RegionMap(f"<b>ψ<sub>{axis}</sub></b>, ± mVs", half[..., k], "mVs")
        for k, axis in enumerate(_AXES)
    ]
    return region_maps(grid, maps)


def differential_inductances(fit: Fit) -> go.Figure:
    """Draw contours of L_dd, L_dq and L_qq, µH, grey outside the excited region."""
    grid = current_grid(fit, _CONTOUR_POINTS)
    inductance = fit.differential_inductance(*grid.mesh) * 1e6
    maps = [
        RegionMap(f"<b>L<sub>{_AXES[j]}{_AXES[k]}</sub></b> in µH", inductance[j, k], "µH")
        for j, k in ((0, 0), (0, 1), (1, 1))
    ]
    return region_maps(grid, maps)


def flux_map_surfaces(fit: Fit) -> go.Figure:
    """Draw psi_d and psi_q in mVs as surfaces over the currents, inside the excited region."""
    i_d, i_q, inside = _trimmed(fit, current_grid(fit, _SURFACE_POINTS))
    psi = np.where(inside, fit.flux_map(i_d, i_q) * 1e3, np.nan)
    figure = panels.blank_figure()
    for scene, axis, height in zip(("scene", "scene2"), _AXES, psi, strict=True):
        figure.add_trace(_surface(i_d, i_q, height, axis).update(scene=scene))
        figure.layout[scene] = {
            "xaxis": {"title": {"text": f"{_CURRENTS[0]} in A"}, "nticks": 5},
            "yaxis": {"title": {"text": f"{_CURRENTS[1]} in A"}, "nticks": 5},
            "zaxis": {"title": {"text": ""}, "nticks": 6},
            "camera": {"eye": {"x": -1.35, "y": -1.6, "z": 0.95}, "center": {"z": -0.12}},
            "aspectmode": "manual",
            "aspectratio": {"x": 1, "y": 1, "z": 0.78},
        }
    figure.update_layout(
        **_scenes([([0, 0.49], [0, 1]), ([0.51, 1], [0, 1])], 440),
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        meta={"narrow": _scenes([([0, 1], [0.51, 1]), ([0, 1], [0, 0.49])], 780)},
    )
    return figure


def _surface(i_d: FloatArray, i_q: FloatArray, height: FloatArray, axis: str) -> go.Surface:
    steps = len(palette.SURFACE) - 1
    return go.Surface(
        x=panels.compact(i_d),
        y=panels.compact(i_q),
        z=panels.compact(height),
        colorscale=[[k / steps, colour] for k, colour in enumerate(palette.SURFACE)],
        showscale=False,
        contours={"z": {"show": True, "color": "rgba(255,255,255,0.45)", "width": 1}},
        lighting={"ambient": 0.72, "diffuse": 0.5, "specular": 0.06, "roughness": 0.9},
        hovertemplate=(
            f"{_CURRENTS[0]} %{{x:.4~g}} A, {_CURRENTS[1]} %{{y:.4~g}} A<br>"
            f"ψ<sub>{axis}</sub> %{{z:.4~g}} mVs<extra></extra>"
        ),
    )


def _scenes(domains: list[tuple[list[float], list[float]]], height: int) -> dict[str, Any]:
    """Return the layout entries that say where the two scenes and their titles lie."""
    titles = [
        {
            "text": f"<b>ψ<sub>{axis}</sub></b> in mVs",
            "x": x[0],
            "y": y[1],
            "xref": "paper",
            "yref": "paper",
            "xanchor": "left",
            "yanchor": "top",
            "font": {"size": 14},
        }
        for axis, (x, y) in zip(_AXES, domains, strict=True)
    ]
    scenes = {
        scene: {"domain": {"x": x, "y": y}}
        for scene, (x, y) in zip(("scene", "scene2"), domains, strict=True)
    }
    return {**scenes, "annotations": titles, "height": height}


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
