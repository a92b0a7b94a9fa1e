"""One picture of the difference between two flux maps."""

import numpy as np
from matplotlib.figure import Figure

from penode.pmsm.comparison.map_comparison import MapComparison
from penode.report.png import png


def comparison_picture(comparison: MapComparison, title: str) -> bytes:
    """Return a PNG of the differences of psi_d and psi_q over the currents, on one scale in mVs.

    The panels are empty where one of the two maps is not supported.
    """
    figure = Figure(figsize=(11, 4.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    limit = 1e3 * float(np.nanmax(np.abs(comparison.difference))) or 1.0
    currents = (comparison.i_d, comparison.i_q)
    for axes, axis, difference in zip(panels, "dq", 1e3 * comparison.difference, strict=True):
        image = axes.pcolormesh(
            *currents, difference.T, cmap="RdBu_r", vmin=-limit, vmax=limit, shading="nearest"
        )
        axes.set(aspect="equal", xlabel="i_d (A)")
        axes.set_title(f"difference of ψ_{axis}", loc="left", fontsize=10)
    panels[0].set_ylabel("i_q (A)")
    figure.colorbar(image, ax=panels, label="mVs", shrink=0.9)
    return png(figure, panels, title)
