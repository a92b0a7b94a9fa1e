"""What a machine is known by beside R: flux linkage and inductances at no current, temperature."""

import numpy as np

from penode.fit.fit import Fit
from penode.fit.outcome import Estimate
from penode.pmsm.machine.standstill import STANDSTILL, excited_axes
from penode.pmsm.machine.temperatures import temperatures_of
from penode.report.document import KeyValue
from penode.report.quantities import number, with_unit
from penode.report.statements import estimate_text


def at_no_current(fit: Fit) -> dict[str, Estimate]:
    """Return psi_PM in Vs with its deviation, and L_d and L_q in H without one, at no current.

    Nothing where the recordings do not answer, do not reach no current, or stand still or move one
    axis alone, where the constant of the flux linkage is not known.
    """
    nowhere = np.zeros((1, 2))
    at_rest = bool(fit.provenance.get(STANDSTILL)) or not excited_axes(fit).all()
    if at_rest or not fit.horizon.answered or not np.all(fit.supported(nowhere)):
        return {}
    psi, slope = float(fit.flux_map(0.0, 0.0)[0]), fit.differential_inductance(0.0, 0.0)
    deviation = float(fit.learned_deviation(nowhere)[0, 0])
    inductances = {f"L_{axis}": float(slope[k, k]) for k, axis in enumerate("dq")}
    return {
        "psi_PM": Estimate.of(psi, deviation, "Vs"),
        **{name: Estimate.of(value, np.nan, "H") for name, value in inductances.items()},
    }


def no_current(fit: Fit) -> tuple[KeyValue, ...]:
    """Return psi_PM with its 95 % interval, and L_d and L_q, in words; nothing where not known."""
    known = at_no_current(fit)
    if not known:
        return ()
    psi = known["psi_PM"]
    text, detail = with_unit(psi.value, "Vs"), ""
    if np.isfinite(psi.std):
        text, interval = estimate_text(psi)
        detail = f"95 % interval {interval}"
    l_d, l_q = (with_unit(known[name].value, "H") for name in ("L_d", "L_q"))
    return (
        KeyValue("Magnet's flux linkage psi_PM", text, detail, psi.value),
        KeyValue("Inductances L_d, L_q", f"{l_d}, {l_q}", "of the d and the q axis at no current"),
    )


def of_winding(fit: Fit) -> tuple[KeyValue, ...]:
    """Return the temperature that R belongs to; nothing where none was recorded."""
    known = temperatures_of(fit)
    if known.resistance is None or not fit.horizon.answered:
        return ()
    sentence = known.of_resistance.replace(" degC", "\N{NO-BREAK SPACE}°C")
    text = f"{number(known.resistance)}\N{NO-BREAK SPACE}°C"
    return (KeyValue("Winding that R belongs to", text, sentence, known.resistance),)
