"""Inductances of a machine at a few currents: apparent, differential, saliency and coupling."""

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.pmsm.control.controlled_machine import ControlledMachine, largest_current
from penode.pmsm.control.loci import mtpa
from penode.pmsm.machine.standstill import STANDSTILL, excited_axes
from penode.report.document import Cell, Table
from penode.report.quantities import decimals_for, fixed, scale_for
from penode.report.tables import Column, numeric, table

_SPACE = "\N{NO-BREAK SPACE}"
#: Currents over the largest recorded ones of each axis, with their name.
_AT = (
    ("no current", 0.0, 0.0),
    ("q axis", 0.0, 0.5),
    ("q axis", 0.0, 0.9),
    ("d axis", 0.5, 0.0),
    ("d axis", 0.9, 0.0),
    ("both axes", 0.5, 0.5),
)
#: The same of MTPA, over the largest recorded current.
_ON_MTPA = (0.25, 0.5, 0.75)
_CAPTION = (
    "Apparent: the mean slope from zero current of its own axis, "
    "L_d = (ψ_d(i_d, i_q) − ψ_d(0, i_q)) / i_d and L_q = (ψ_q(i_d, i_q) − ψ_q(i_d, 0)) / i_q. "
    "Differential: the slope at the current, L_dd, L_qq and the cross-coupling L_dq. Saliency is "
    "q over d; coupling is L_dq over √(L_dd L_qq). Where L_d changes with i_q, or L_q with i_d, "
    "that is cross-saturation. ± is half the width of the 95 % interval."
)


def inductance_table(fit: Fit) -> Table:
    """Tabulate apparent and differential inductances at currents of both axes and on MTPA."""
    names, current = _currents(fit)
    apparent = apparent_inductances(fit, current)
    slope = np.asarray(fit.differential_inductance(*current))
    excited = excited_axes(fit)
    apparent[~excited], slope[~excited], slope[:, ~excited] = np.nan, np.nan, np.nan
    scale = scale_for([apparent[np.isfinite(apparent)].max(initial=0.0)], "H")
    inductances = {
        "L_d": apparent[0],
        "L_q": apparent[1],
        "L_dd": slope[0, 0],
        "L_dq": (slope[0, 1] + slope[1, 0]) / 2,
        "L_qq": slope[1, 1],
    }
    halves = {name: NORMAL_95 * one for name, one in _deviations(fit, current).items()}
    with np.errstate(invalid="ignore"):  # no real number where the map is indefinite
        root = np.sqrt(slope[0, 0] * slope[1, 1])
    ratios = {
        "apparent saliency": apparent[1] / apparent[0],
        "differential saliency": slope[1, 1] / slope[0, 0],
        f"coupling in{_SPACE}%": 100 * inductances["L_dq"] / root,
    }
    columns: list[Column] = [
        ("at", names),
        *(
            (f"{one} in{_SPACE}A", _cells(i))
            for one, i in zip(("i_d", "i_q"), current, strict=True)
        ),
        *(
            (f"{n} in{_SPACE}{scale.unit}", _cells(v, scale.factor, halves.get(n)))
            for n, v in inductances.items()
        ),
        *((name, _cells(values)) for name, values in ratios.items()),
    ]
    inside: BoolArray = np.asarray(fit.supported(current.T))
    marks = ["" if one else "extrapolated" for one in inside]
    return table("Inductances at a few currents", columns, _CAPTION, marks)


def _deviations(fit: Fit, current: FloatArray) -> dict[str, FloatArray]:
    """Return the deviations (point,) of L_dd and L_qq at currents (2, point), in H."""
    if not fit.horizon.answered:
        return {}
    of_axes = [fit.learned_deviation(current.T, np.eye(2)[k])[:, k] for k in range(2)]
    return dict(zip(("L_dd", "L_qq"), of_axes, strict=True))


def _cells(
    values: FloatArray, factor: float = 1.0, half: FloatArray | None = None
) -> list[Cell | str]:
    """Return cells of SI values with the decimals that give the largest three digits.

    Behind a value stands the half width of its interval, SI, where there is one.
    """
    shown = values * factor
    largest = float(np.abs(shown[np.isfinite(shown)]).max(initial=0.0))
    decimals = max(decimals_for(0.0, largest) - 1, 0)
    pairs = zip(shown.tolist(), values.tolist(), strict=True)
    if half is None:
        return [numeric(fixed(text, decimals), value) for text, value in pairs]
    widths = (half * factor).tolist()
    least = min((width for width in widths if 0 < width < np.inf), default=1.0)
    decimals = max(decimals, min(decimals_for(least, 0.0) - 1, decimals + 2))
    return [
        numeric(f"{fixed(text, decimals)} ± {fixed(width, decimals)}", value)
        if np.isfinite([text, width]).all()
        else numeric(fixed(text, decimals), value)
        for (text, value), width in zip(pairs, widths, strict=True)
    ]


def apparent_inductances(fit: Fit, current: FloatArray) -> FloatArray:
    """Return L_d and L_q (2, point), H, the mean slopes from zero current of the own axis.

    At no current of the axis they are its differential inductance.
    """
    psi, slope = fit.flux_map(*current), fit.differential_inductance(*current)
    apparent = np.stack([slope[0, 0], slope[1, 1]])
    for axis in range(2):
        at_zero = current.copy()
        at_zero[axis] = 0.0
        moved = current[axis] != 0
        rise = (psi - fit.flux_map(*at_zero))[axis]
        apparent[axis, moved] = rise[moved] / current[axis, moved]
    return apparent


def _currents(fit: Fit) -> tuple[list[str], FloatArray]:
    """Return names and currents (2, point), A, of two digits, of the rows of the table."""
    low, high = fit.excited.min(axis=0), fit.excited.max(axis=0)
    # Fields are weakened by negative i_d: it is shown wherever there is any to speak of.
    largest = np.where(-low > np.array([0.5, 2.0]) * high, low, high)
    points = [(name, *(largest * (d, q))) for name, d, q in _AT]
    if excited_axes(fit).all() and not fit.provenance.get(STANDSTILL):
        radii = np.array(_ON_MTPA) * largest_current(fit)
        on_mtpa = mtpa(ControlledMachine.of(fit, 1), radii).current.T
        points += [("MTPA", *one) for one in on_mtpa]
    points = [one for one in points if np.isfinite(one[1:]).all()]
    current = [[float(f"{one:.2g}") for one in point[1:]] for point in points]
    return [point[0] for point in points], np.array(current).T
