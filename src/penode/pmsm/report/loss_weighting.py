"""What each horizon listens to in a drive's residual, as a section of its report."""

from penode.fit.fit import Fit
from penode.horizon.loss_weighting import loss_weighting
from penode.pmsm.report.line_causes import NamedLine, named_lines, signed_frequency
from penode.report.document import Section
from penode.report.loss_weighting import Name, prefilter_section, unnamed
from penode.report.quantities import fixed, number, with_unit


def listening(fit: Fit) -> list[Section]:
    """Return the section on what the loss at H = 1, the selected and the longest horizon weighs.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine.

    Returns
    -------
    list of Section
        Empty where the fit keeps no one-step matrices or no prediction.
    """
    if not fit.transitions.size or not fit.comparisons:
        return []
    ladder = [rung.horizon for rung in fit.horizon.ladder]
    horizons = sorted({1, fit.horizon.selected, max(ladder, default=1)})
    base = float(fit.provenance.get("electrical_frequency_hz") or 0.0)
    base = signed_frequency(base, fit.transitions)
    view = loss_weighting(fit.comparisons[0], fit.transitions, horizons, base or None)
    if not base:
        return [prefilter_section(view, unnamed(view))]
    found = named_lines(view.lines, base, fit.provenance.get("pole_pairs"))
    note = (
        f"Orders (×) count the electrical frequency, {with_unit(base, 'Hz')}, as the rotor sees "
        "it; in the phases each is one higher."
    )
    return [prefilter_section(view, [_name(one) for one in found], note)]


def _name(one: NamedLine) -> Name:
    inner, outer = (_times(order) for order in (one.order, one.stationary_order))
    return Name(one.line, inner, f"{outer} in the phases: {one.cause}")


def _times(order: float) -> str:
    sign = "+" if order > 0 else ""
    return f"{sign}{fixed(order, 0) if order == round(order) else number(order)}×"
