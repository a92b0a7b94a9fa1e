"""Pictures of a machine's flux-linkage map and of its differential inductances."""

from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from scipy import ndimage

from penode.arrays import BoolArray, FloatArray
from penode.report import palette, panels
from penode.training.fit import Fit

_CONTOUR_POINTS = 121
_SURFACE_POINTS = 61
_DOTS = 1500
_LEVELS = 10
_BISECTIONS = 8
#: Pixels: width of a row of panels, space between panels, greatest height of a panel.
_ROW_WIDTH, _GAP, _ROW_HEIGHT = 866.0, 92.0, 600.0
_AXES = ("d", "q")


@dataclass(frozen=True, eq=False)
class MapGrid:
    """Currents at which maps are drawn.

    Attributes
    ----------
    i_d, i_q : ndarray, shape (column,) and (row,)
        Currents in A.
    supported : ndarray of bool, shape (row, column)
        Whether the recordings visited the neighbourhood.
    """

    i_d: FloatArray
    i_q: FloatArray
    supported: BoolArray

    @property
    def mesh(self) -> tuple[FloatArray, FloatArray]:
        """Currents i_d and i_q of every point, each of shape (row, column), in A."""
        i_d, i_q = np.meshgrid(self.i_d, self.i_q)
        return i_d, i_q


def map_grid(fit: Fit, points: int) -> MapGrid:
    """Return a grid around the excited region.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine.
    points : int
        Grid points per axis.

    Returns
    -------
    MapGrid
        The grid.
    """
    low, high = fit.excited.min(axis=0), fit.excited.max(axis=0)
    margin = 0.08 * max(float(np.max(high - low)), 1e-9)
    i_d, i_q = (np.linspace(a - margin, b + margin, points) for a, b in zip(low, high, strict=True))
    mesh = np.stack(np.meshgrid(i_d, i_q), axis=-1)
    supported = fit.supported(mesh.reshape(-1, 2)).reshape(points, points)
    return MapGrid(i_d, i_q, supported)


def flux_map_contours(fit: Fit) -> go.Figure:
    """Draw contours of psi_d and psi_q over the currents.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine.

    Returns
    -------
    plotly.graph_objects.Figure
        Two panels of one aspect, labelled in mVs; greyed outside the excited region, the recorded
        currents as dots.
    """
    grid = map_grid(fit, _CONTOUR_POINTS)
    psi = fit.flux_map(*grid.mesh) * 1e3
    titles = [f"<b>ψ<sub>{axis}</sub></b> in mVs" for axis in _AXES]
    return _maps(fit, grid, list(psi), titles, "mVs")


def differential_inductances(fit: Fit) -> go.Figure:
    """Draw contours of L_dd, L_dq and L_qq over the currents.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine.

    Returns
    -------
    plotly.graph_objects.Figure
        Three panels of one aspect, labelled in µH; greyed outside the excited region.
    """
    grid = map_grid(fit, _CONTOUR_POINTS)
    inductance = fit.differential_inductance(*grid.mesh) * 1e6
    entries = ((0, 0), (0, 1), (1, 1))
    titles = [f"<b>L<sub>{_AXES[row]}{_AXES[column]}</sub></b> in µH" for row, column in entries]
    return _maps(fit, grid, [inductance[entry] for entry in entries], titles, "µH")


def flux_map_surfaces(fit: Fit) -> go.Figure:
    """Draw psi_d and psi_q as surfaces over the currents.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine.

    Returns
    -------
    plotly.graph_objects.Figure
        Two scenes in mVs; nothing is drawn outside the excited region.
    """
    grid = map_grid(fit, _SURFACE_POINTS)
    i_d, i_q, inside = _trimmed(fit, grid)
    psi = np.where(inside, fit.flux_map(i_d, i_q) * 1e3, np.nan)
    figure = panels.blank_figure()
    steps = len(palette.SURFACE) - 1
    for number, (axis, height) in enumerate(zip(_AXES, psi, strict=True)):
        figure.add_trace(
            go.Surface(
                x=panels.compact(i_d),
                y=panels.compact(i_q),
                z=panels.compact(height),
                scene="scene" if number == 0 else "scene2",
                colorscale=[[k / steps, colour] for k, colour in enumerate(palette.SURFACE)],
                showscale=False,
                contours={"z": {"show": True, "color": "rgba(255,255,255,0.45)", "width": 1}},
                lighting={"ambient": 0.72, "diffuse": 0.5, "specular": 0.06, "roughness": 0.9},
                hovertemplate=(
                    "i<sub>d</sub> %{x:.4~g} A, i<sub>q</sub> %{y:.4~g} A<br>"
                    f"ψ<sub>{axis}</sub> %{{z:.4~g}} mVs<extra></extra>"
                ),
            )
        )
    scenes = {
        key: {
            "xaxis": {"title": {"text": "i<sub>d</sub> in A"}, "nticks": 5},
            "yaxis": {"title": {"text": "i<sub>q</sub> in A"}, "nticks": 5},
            "zaxis": {"title": {"text": f"ψ<sub>{axis}</sub> in mVs"}, "nticks": 6},
            "camera": {"eye": {"x": -1.35, "y": -1.6, "z": 0.95}, "center": {"z": -0.12}},
            "aspectmode": "manual",
            "aspectratio": {"x": 1, "y": 1, "z": 0.78},
        }
        for key, axis in zip(("scene", "scene2"), _AXES, strict=True)
    }
    domains = ({"x": [0, 0.49], "y": [0, 1]}, {"x": [0.51, 1], "y": [0, 1]})
    pile = ({"x": [0, 1], "y": [0.51, 1]}, {"x": [0, 1], "y": [0, 0.49]})
    figure.update_layout(**scenes, height=480, margin={"l": 0, "r": 0, "t": 0, "b": 0})
    figure.update_layout(scene_domain=domains[0], scene2_domain=domains[1])
    narrow = {"scene": {"domain": pile[0]}, "scene2": {"domain": pile[1]}, "height": 780}
    figure.update_layout(meta={"narrow": narrow})
    return figure


def _trimmed(fit: Fit, grid: MapGrid) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Move the grid points just outside the excited region onto its boundary.

    A surface that ended at whole grid cells would have a torn edge.
    """
    mesh = np.stack(grid.mesh, axis=-1)
    kernel = np.ones((3, 3))
    weight = ndimage.convolve(grid.supported.astype(np.float64), kernel, mode="constant")
    edge = ~grid.supported & (weight > 0)
    inner = np.stack(
        [
            ndimage.convolve(mesh[..., k] * grid.supported, kernel, mode="constant")[edge]
            / weight[edge]
            for k in range(2)
        ],
        axis=-1,
    )
    inside = grid.supported.copy()
    inside[edge] = fit.supported(inner)
    outer = mesh[edge]
    for _ in range(_BISECTIONS):
        middle = (inner + outer) / 2
        within = fit.supported(middle)[:, None]
        inner, outer = np.where(within, middle, inner), np.where(within, outer, middle)
    mesh[edge] = inner
    return mesh[..., 0], mesh[..., 1], inside


def _maps(
    fit: Fit, grid: MapGrid, maps: list[FloatArray], titles: list[str], unit: str
) -> go.Figure:
    figure = panels.blank_figure()
    for panel, (values, title) in enumerate(zip(maps, titles, strict=True)):
        _draw_map(figure, grid, values, panel, unit)
        _draw_region(figure, fit, grid, panel)
        figure.add_annotation(
            text=title,
            x=0,
            xref=f"{panels.axis_id('x', panel)} domain",
            xanchor="left",
            y=1,
            yref=f"{panels.axis_id('y', panel)} domain",
            yanchor="bottom",
            yshift=4,
            font={"size": 14},
        )
    count = len(maps)
    panels.place(figure, *_boxes(grid, count))
    for panel in range(count):
        x, y = panels.axis_id("x", panel), panels.axis_id("y", panel)
        figure.layout[panels.axis_key("x", panel)].update(
            anchor=y,
            range=[grid.i_d[0], grid.i_d[-1]],
            constrain="domain",
            constraintoward="left",
            nticks=6,
            title_text="i<sub>d</sub> in A",
        )
        figure.layout[panels.axis_key("y", panel)].update(
            anchor=x,
            range=[grid.i_q[0], grid.i_q[-1]],
            constrain="domain",
            scaleanchor=x,
            nticks=7,
            title_text="i<sub>q</sub> in A",
        )
    figure.update_layout(showlegend=False, hovermode="closest")
    return figure


def _boxes(
    grid: MapGrid, count: int
) -> tuple[tuple[list[panels.Box], float], tuple[list[panels.Box], float]]:
    """Return boxes in a row and in a pile, as wide as maps of equal aspect need them."""
    aspect = float(np.ptp(grid.i_d) / np.ptp(grid.i_q))
    widest = (_ROW_WIDTH - (count - 1) * _GAP) / count
    height = float(np.clip(widest / aspect, 260.0, _ROW_HEIGHT))
    width = min(widest, height * aspect)
    rest = _ROW_WIDTH - count * width - (count - 1) * _GAP
    wide, total = panels.grid([width] * count + [rest], [height], _GAP, [])
    pile = panels.grid(
        [1.0], [float(np.clip(300.0 / aspect, 200.0, 420.0))] * count, 0.0, [84.0] * (count - 1)
    )
    return (wide[:count], total), pile


def _smooth(region: BoolArray) -> FloatArray:
    """Return the region as 1 and 0 with its staircase of grid cells rounded off at 0.5."""
    return np.asarray(ndimage.gaussian_filter(region.astype(np.float64), 1.2, mode="nearest"))


def _draw_map(figure: go.Figure, grid: MapGrid, values: FloatArray, panel: int, unit: str) -> None:
    visible = values[grid.supported & np.isfinite(values)]
    levels = nice_levels(visible if visible.size else values[np.isfinite(values)], _LEVELS)
    steps = len(palette.SEQUENCE) - 1
    figure.add_trace(
        go.Contour(
            x=panels.compact(grid.i_d),
            y=panels.compact(grid.i_q),
            z=panels.compact(values),
            xaxis=panels.axis_id("x", panel),
            yaxis=panels.axis_id("y", panel),
            colorscale=[[k / steps, colour.light] for k, colour in enumerate(palette.SEQUENCE)],
            zmin=levels[0],
            zmax=levels[-1],
            showscale=False,
            contours={
                "start": levels[0],
                "end": levels[-1],
                "size": levels[1] - levels[0],
                "coloring": "heatmap",
                "showlabels": True,
                "labelfont": {"color": palette.INK.light, "size": 12},
            },
            line={"color": palette.CONTOUR.light, "width": 1},
            hovertemplate=(
                "i<sub>d</sub> %{x:.4~g} A, i<sub>q</sub> %{y:.4~g} A<br>"
                f"%{{z:.4~g}} {unit}<extra></extra>"
            ),
        )
    )


def _draw_region(figure: go.Figure, fit: Fit, grid: MapGrid, panel: int) -> None:
    """Grey what was not visited, outline the rest and dot the recorded currents."""
    axes = {"xaxis": panels.axis_id("x", panel), "yaxis": panels.axis_id("y", panel)}
    if not grid.supported.all():
        figure.add_trace(
            go.Contour(
                x=panels.compact(grid.i_d),
                y=panels.compact(grid.i_q),
                z=panels.compact(_smooth(grid.supported)),
                **axes,
                contours={"type": "constraint", "operation": ">", "value": 0.5},
                fillcolor=palette.VEIL.light,
                line={"color": palette.OUTLINE.light, "width": 1.6, "dash": "dash"},
                hoverinfo="skip",
                showlegend=False,
            )
        )
    dots = fit.excited[:: max(1, len(fit.excited) // _DOTS)]
    figure.add_trace(
        go.Scatter(
            x=panels.compact(dots[:, 0]),
            y=panels.compact(dots[:, 1]),
            **axes,
            mode="markers",
            marker={"size": 2.2, "color": palette.VISITED.light},
            hoverinfo="skip",
        )
    )


def nice_levels(values: FloatArray, count: int) -> FloatArray:
    """Return contour levels at round numbers.

    Parameters
    ----------
    values : ndarray
        What the levels must cover; finite.
    count : int
        About how many levels.

    Returns
    -------
    ndarray, shape (level,)
        Multiples of 1, 2 or 5 times a power of ten, from below the lowest value to above the
        highest; at least two.
    """
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high), 1e-30):
        span = max(abs(low), 1.0) * 0.1
    raw = span / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(factor for factor in (1, 2, 5, 10) if factor * power >= raw * (1 - 1e-9))
    first, last = np.floor(low / step), np.ceil(high / step)
    return np.asarray(np.arange(first, max(last, first + 1) + 1) * step)
