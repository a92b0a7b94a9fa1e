"""What a machine is known by beside R: flux linkage and inductances at no current, temperature."""

import numpy as np

from penode.fit.fit import Fit
from penode.fit.outcome import Estimate
from penode.pmsm.machine.standstill import STANDSTILL, excited_axes
from penode.pmsm.machine.temperatures import UNKNOWN, temperatures_of
from penode.report.document import KeyValue
from penode.report.quantities import number, with_unit
from penode.report.statements import estimate_text

_TITLES = {
    "psi_PM": "Magnet's flux linkage psi_PM",
    "L_d": "Inductance L_d at no current",
    "L_q": "Inductance L_q at no current",
}


def at_no_current(fit: Fit) -> dict[str, Estimate]:
    """Return psi_PM in Vs, L_d and L_q in H at no current, with their deviations.

    Nothing where the recordings do not answer, do not reach no current, or stand still or move one
    axis alone, where the constant of the flux linkage is not known.
    """
    nowhere = np.zeros((1, 2))
    at_rest = bool(fit.provenance.get(STANDSTILL)) or not excited_axes(fit).all()
    if at_rest or not fit.horizon.answered or not np.all(fit.supported(nowhere)):
        return {}
    psi, slope = float(fit.flux_map(0.0, 0.0)[0]), fit.differential_inductance(0.0, 0.0)
    deviation = float(fit.learned_deviation(nowhere)[0, 0])
    known = {"psi_PM": Estimate.of(psi, deviation, "Vs")}
    for k, axis in enumerate("dq"):
        deviation = float(fit.learned_deviation(nowhere, np.eye(2)[k])[0, k])
        known[f"L_{axis}"] = Estimate.of(float(slope[k, k]), deviation, "H")
    return known


def no_current(fit: Fit) -> tuple[KeyValue, ...]:
    """Return psi_PM, L_d and L_q with their 95 % intervals, in words; nothing where not known."""
    return tuple(_in_words(name, one) for name, one in at_no_current(fit).items())


def _in_words(name: str, estimate: Estimate) -> KeyValue:
    text, detail = with_unit(estimate.value, estimate.unit), ""
    if np.isfinite(estimate.std):
        text, interval = estimate_text(estimate)
        detail = f"95 % interval {interval}"
    return KeyValue(_TITLES[name], text, detail, estimate.value)


def of_winding(fit: Fit) -> tuple[KeyValue, ...]:
    """Return the temperature that R belongs to; nothing where no recording has one."""
    known = temperatures_of(fit)
    if known.of_resistance == UNKNOWN.of_resistance or not fit.horizon.answered:
        return ()
    sentence = known.of_resistance.replace(" degC", "\N{NO-BREAK SPACE}°C")
    if known.resistance is None:
        return (KeyValue("Winding that R belongs to", "not known", sentence),)
    text = f"{number(known.resistance)}\N{NO-BREAK SPACE}°C"
    return (KeyValue("Winding that R belongs to", text, sentence, known.resistance),)
