"""The report's sections on a machine's maps: flux linkage, its uncertainty, inductances."""

import numpy as np

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.pmsm.report import map_figures
from penode.report.document import Figure, Notice, Section
from penode.report.guard import picture
from penode.report.learned_maps import band_title
from penode.report.statements import range_text

_GREY = (
    "Inside the dashed outline lie the recorded currents (dots). Outside it, greyed, the map is "
    "an extrapolation that no recording supports."
)


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
                _GREY,
                map_figures.flux_map_contours,
                fit,
            ),
            picture(
                "The same map in perspective",
                "Drawn where the recordings support it. Drag, or use the arrow keys, to turn it.",
                map_figures.flux_map_surfaces,
                fit,
            ),
            *_bands(fit),
        ],
    )


def _bands(fit: Fit) -> list[Figure | Notice]:
    grid, half = map_figures.band_widths(fit)
    inside = half[grid.supported]
    if not inside.size or not np.isfinite(inside).all():
        return []
    widest = float(np.quantile(inside, 0.95))
    return [
        picture(
            band_title("The map", inside, "mVs", "recorded currents"),
            "Half the width of the 95 % band around each flux linkage; where it is wider than over "
            "95 % of the recorded currents, that value is drawn. Like the interval of R it allows "
            "for residuals that are correlated in time and for the spread over the horizons that "
            "agree, and it holds if the model's structure is right.",
            map_figures.flux_map_bands,
            grid,
            np.minimum(half, widest),
        )
    ]


def inductances(fit: Fit) -> Section:
    """Return the section on the differential inductances."""
    inductance = _supported(fit, fit.differential_inductance(*fit.excited.T))
    d_axis, cross, q_axis = (
        range_text(inductance[entry], "H") for entry in ((0, 0), (0, 1), (1, 1))
    )
    return Section(
        "Differential inductances",
        "The slope of the flux-linkage map: what a current controller or a position observer "
        "meets at each operating point. The cross-coupling is zero in a linear machine.",
        [
            picture(
                f"d axis {d_axis}, q axis {q_axis}, cross-coupling {cross}",
                _GREY,
                map_figures.differential_inductances,
                fit,
            )
        ],
    )


def _supported(fit: Fit, values: FloatArray) -> FloatArray:
    """Return map values (..., sample) at the recorded currents in the excited region."""
    chosen = values[..., fit.supported(fit.excited)]
    return chosen if chosen.shape[-1] else values
