"""The report's sections on a machine's maps: flux linkage, its uncertainty, inductances."""

import numpy as np

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.pmsm.report import map_figures as machine_figures
from penode.report.document import Figure, Section
from penode.report.quantities import number
from penode.report.statements import range_text

_GREY = (
    "Inside the dashed outline lie the recorded currents (dots). Outside it, greyed, the map is "
    "an extrapolation that no recording supports."
)


def flux_linkage(fit: Fit) -> Section:
    """Return the section on the flux-linkage map and how sure it is."""
    psi = _visited(fit, fit.flux_map(*fit.excited.T))
    spans = [range_text(values, "Vs") for values in psi]
    return Section(
        "Flux-linkage map",
        "How much flux the windings link at each pair of currents, averaged over the rotor's "
        "angle. Straight and evenly spaced contours would mean a linear machine; where they "
        "bend or draw apart, the iron saturates.",
        [
            Figure(
                f"Flux linkage of {spans[0]} in the d axis and {spans[1]} in the q axis",
                _GREY,
                machine_figures.flux_map_contours(fit),
            ),
            Figure(
                "The same map in perspective",
                "Drawn where the recordings support it. Drag, or use the arrow keys, to turn it.",
                machine_figures.flux_map_surfaces(fit),
            ),
            *_bands(fit),
        ],
    )


def _bands(fit: Fit) -> list[Figure]:
    grid, half = machine_figures.band_widths(fit)
    inside = half[grid.supported]
    if not inside.size or not np.isfinite(inside).all():
        return []
    half_of, most_of = (float(np.quantile(inside, share)) for share in (0.5, 0.95))
    return [
        Figure(
            f"The map is known to ±{number(half_of, 2)} mVs over half of the recorded currents, to "
            f"±{number(most_of, 2)} mVs over 95 % of them",
            "Half the width of the 95 % band around each flux linkage; where it is wider than over "
            "95 % of the recorded currents, that value is drawn. Like the interval of R it allows "
            "for residuals that are correlated in time and for the spread over the horizons that "
            "agree, and it holds if the model's structure is right.",
            machine_figures.flux_map_bands(grid, np.minimum(half, most_of)),
        )
    ]


def inductances(fit: Fit) -> Section:
    """Return the section on the differential inductances."""
    inductance = _visited(fit, fit.differential_inductance(*fit.excited.T))
    d_axis, cross, q_axis = (
        range_text(inductance[entry], "H") for entry in ((0, 0), (0, 1), (1, 1))
    )
    return Section(
        "Differential inductances",
        "The slope of the flux-linkage map: what a current controller or a position observer "
        "meets at each operating point. The cross-coupling is zero in a linear machine.",
        [
            Figure(
                f"d axis {d_axis}, q axis {q_axis}, cross-coupling {cross}",
                _GREY,
                machine_figures.differential_inductances(fit),
            )
        ],
    )


def _visited(fit: Fit, values: FloatArray) -> FloatArray:
    """Return map values (..., sample) at the visited currents that count as supported."""
    chosen = values[..., fit.supported(fit.excited)]
    return chosen if chosen.shape[-1] else values
