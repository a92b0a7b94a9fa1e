"""The report's section on a second map: of another fit, or a table of finite elements."""

from dataclasses import dataclass, replace

import numpy as np
import plotly.graph_objects as go
from scipy.interpolate import RegularGridInterpolator

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.pmsm.comparison.map_comparison import (
    MapComparison,
    compare_maps,
    compare_resistances,
)
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.report.flux_sections import current_grid
from penode.report import palette
from penode.report.document import Section, picture
from penode.report.region_map import RegionGrid, region_maps

_POINTS = 121
_FLUX = ("<b>ψ<sub>d</sub></b>", "<b>ψ<sub>q</sub></b>")


@dataclass(frozen=True, eq=False)
class Against:
    """A second map that a fit is held against, under a name; its own less the fit's."""

    name: str
    comparison: MapComparison
    resistances: str = ""

    @classmethod
    def of(cls, fit: Fit, name: str, other: Fit | FluxGrid) -> "Against":
        """Compare a fit with another, or with a table of a map.

        Raises
        ------
        InputError
            If there is no current at which both are supported.
        """
        return cls(name, compare_maps(fit, other), compare_resistances(fit, other))

    def second_map(self, fit: Fit) -> Section:
        """Return the section: contours of both maps over each other, and their difference."""
        grid, difference = self._drawn(fit)
        resistances = f" {self.resistances}." if self.resistances else ""
        where = "Grey: one of the two is not known there."
        sentence = self.comparison.sentence
        return Section(
            "Against another map",
            f"{self.name}, less the map of this fit.{resistances}",
            [
                picture(
                    f"{sentence[:1].upper()}{sentence[1:]}",
                    f"The difference, interpolated between the points that were compared. {where}",
                    region_maps,
                    grid,
                    [f"{title}, difference in mVs" for title in _FLUX],
                    1e3 * difference,
                    "mVs",
                ),
                picture(
                    "Both maps over each other",
                    f"Dark lines and shades: this fit; orange lines: {self.name}, at the same "
                    f"values. {where}",
                    _both,
                    grid,
                    1e3 * fit.flux_map(*grid.mesh),
                    1e3 * difference,
                ),
            ],
        )

    def _drawn(self, fit: Fit) -> tuple[RegionGrid, FloatArray]:
        """Return a grid, supported where both maps are, and the difference on it, (2, row, column).

        The difference is interpolated, not the map: it bends far less between the points.
        """
        one = self.comparison
        grid = current_grid(fit, _POINTS)
        values = np.moveaxis(one.difference, 0, -1)
        between = RegularGridInterpolator(
            (one.i_d, one.i_q), values, bounds_error=False, fill_value=np.nan
        )
        difference = np.moveaxis(between(np.stack(grid.mesh, axis=-1)), -1, 0)
        known = np.isfinite(difference).all(axis=0) & grid.supported
        return replace(grid, supported=known), difference


def _both(grid: RegionGrid, psi: FloatArray, difference: FloatArray) -> go.Figure:
    """Draw contours of a map (2, row, column) and, at the same levels, of that with a difference.

    Both are in mVs.
    """
    figure = region_maps(grid, [f"{title} in mVs" for title in _FLUX], psi, "mVs")
    levels = [t.contours for t in figure.data if t.type == "contour" and t.contours.size]
    others = np.where(grid.supported, psi + difference, np.nan)
    for col, (level, other) in enumerate(zip(levels, others, strict=True), 1):
        figure.add_contour(
            x=grid.x,
            y=grid.y,
            z=other,
            contours={
                "start": level.start,
                "end": level.end,
                "size": level.size,
                "coloring": "none",
            },
            line={"color": palette.FREE_RUN.light, "width": 1.6},
            showlegend=False,
            hoverinfo="skip",
            row=1,
            col=col,
        )
    return figure
