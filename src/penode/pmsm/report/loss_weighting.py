"""How each horizon weighs a drive's residual: lines with their orders and likely causes."""

from penode.fit.fit import Fit
from penode.pmsm.report.line_causes import NamedLine, named_lines, signed_frequency
from penode.report.document import Section
from penode.report.loss_weighting import Name, unnamed, weighting_of, weighting_section
from penode.report.quantities import fixed, number, with_unit


def loss_weighting(fit: Fit) -> Section | None:
    """Return the section on what the loss at H = 1, the selected and the longest horizon weighs.

    None where the fit keeps no one-step matrices or no prediction.
    """
    base = float(fit.provenance.get("electrical_frequency_hz") or 0.0)
    base = signed_frequency(base, fit.transitions) if fit.transitions.size else base
    view = weighting_of(fit, base or None)
    if view is None:
        return None
    if not base:
        return weighting_section(view, unnamed(view), ("A",))
    lines = named_lines(view.lines, base, fit.provenance.get("pole_pairs"))
    note = (
        f"Orders (×) count the electrical frequency, {with_unit(base, 'Hz')}, as the rotor sees "
        "it; in the phases each is one higher."
    )
    return weighting_section(view, [_name(one) for one in lines], ("A",), note)


def _name(one: NamedLine) -> Name:
    inner, outer = (_times(order) for order in (one.order, one.stationary_order))
    return Name(one.line, inner, f"{outer} in the phases: {one.cause}")


def _times(order: float) -> str:
    sign = "+" if order > 0 else ""
    return f"{sign}{fixed(order, 0) if order == round(order) else number(order)}×"
