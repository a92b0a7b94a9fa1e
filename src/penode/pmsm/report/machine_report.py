"""The report of a machine's identification: that of any fit, with the machine's own sections."""

from dataclasses import replace

import numpy as np

from penode.fit.fit import Fit
from penode.pmsm.report.against import Against
from penode.pmsm.report.flux_sections import flux_linkage, inductances
from penode.pmsm.report.line_causes import named_lines, signed_frequency
from penode.pmsm.report.no_current import no_current, of_winding
from penode.pmsm.report.torque_sections import torque_and_operating_points
from penode.report import sections
from penode.report.document import KeyValue, Section
from penode.report.fit_report import Page, Part, fit_report
from penode.report.loss_weighting import weighting_of, weighting_section
from penode.report.points_section import points_balance
from penode.report.quantities import fixed, number, with_unit
from penode.report.statements import listed
from penode.report.tables import parameter_table
from penode.report.uncertainty_budget import uncertainty_budget
from penode.validation.residual_lines import Line

_HARMONIC = 6
_LINES = 8
#: An angle that begins again has a range of one turn, rad.
_TURN = 2 * np.pi


def residual(fit: Fit) -> Section | None:
    """Return the section on the residual, with harmonics of the electrical frequency marked."""
    base = abs(float(fit.provenance.get("electrical_frequency_hz") or 0.0))
    orders = [_HARMONIC * k for k in range(1, _LINES + 1)] if base else []
    followed = getattr(getattr(fit.model, "flux", None), "angle_orders", ())
    map_has = "which a map of the currents alone cannot follow"
    if followed:
        map_has = f"of which the map follows the orders {listed(list(map(str, followed)))}"
    return sections.residual_section(
        fit,
        [(order * base, f"{order}×") for order in orders],
        "Lines at multiples of six times the electrical frequency are the ripple of slots and "
        f"inverter, {map_has}; a longer horizon keeps what is left of it from biasing the "
        "resistance.",
        f"Dotted: multiples of {_HARMONIC} times the electrical frequency "
        f"({with_unit(base, 'Hz')})."
        if base
        else "",
        _speed_and_angle(fit),
    )


def _speed_and_angle(fit: Fit) -> dict[str, str]:
    """Return channel and unit over which the residual is drawn; an angle counted on is none."""
    units = {"omega_el": "rad/s", "theta_el": "rad"}
    return {
        one.channel: units[one.channel]
        for one in fit.correlations.over
        if one.channel == "omega_el" or (one.channel == "theta_el" and np.ptp(one.value) <= _TURN)
    }


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
        return weighting_section(view, ("A",))
    note = (
        f"Orders (×) count the electrical frequency, {with_unit(base, 'Hz')}, as the rotor sees "
        "it; in the phases each is one higher."
    )

    def named(line: Line) -> tuple[str, str]:
        (one,) = named_lines([line], base, fit.provenance.get("pole_pairs"))
        return _times(one.order), f"{_times(one.stationary_order)} in the phases: {one.cause}"

    return weighting_section(view, ("A",), named, note)


def _times(order: float) -> str:
    sign = "+" if order > 0 else ""
    return f"{sign}{fixed(order, 0) if order == round(order) else number(order)}×"


def _beside(fit: Fit) -> tuple[KeyValue, ...]:
    """Return what stands beside R in the answer."""
    return *no_current(fit), *of_winding(fit)


def points_parameters(fit: Fit) -> Section:
    """Return the section on the physical parameters."""
    lead = (
        "What the balance of all points says together, with everything that the bench may be wrong "
        "by left open within its accuracy."
    )
    return Section("Physical parameters", lead, [parameter_table(fit)])


#: Sections of a machine's report in place of those of any fit.
_OWN: dict[Part, tuple[Part, ...]] = {
    sections.learned_maps: (flux_linkage, inductances, torque_and_operating_points),
    sections.residual_section: (residual,),
    sections.loss_weighting: (loss_weighting,),
}

MACHINE_PAGE = Page(
    kind="Machine identification",
    headline=("R",),
    method="together with the machine's flux-linkage map, so that the voltage equation predicts "
    "the measured currents",
    own=_OWN,
    beside=_beside,
    words=(
        (
            "Stator resistance R",
            "Of one phase, at the temperature of the recordings, or at that beside it. Where the "
            "voltages are those that were commanded, cable and conducting switches are in it.",
        ),
        (
            "Flux-linkage map",
            "Flux linkage of the d and the q winding as a function of both currents; saturation "
            "and cross-coupling included.",
        ),
    ),
)

#: The page of a machine from operating points, which have no horizon.
POINTS_PAGE = Page(
    kind="Machine identification from operating points",
    headline=("R",),
    method="together with the machine's flux-linkage map, so that voltages and torque balance",
    parts=(
        points_parameters,
        uncertainty_budget,
        points_balance,
        sections.learned_maps,
        sections.provenance,
    ),
    own={sections.learned_maps: (*_OWN[sections.learned_maps],)},
    beside=_beside,
    words=MACHINE_PAGE.words,
)


def machine_report(fit: Fit, against: Against | None = None) -> str:
    """Return the report of a machine's identification as one self-contained HTML page.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine: its parameters hold ``R`` in ohm, its maps are
        ``flux_map`` (Vs) and ``differential_inductance`` (H).
    against : Against, optional
        A second map, to which a section is given.

    Returns
    -------
    str
        The page; save it as UTF-8.
    """
    page = POINTS_PAGE if fit.stationary is not None and not fit.comparisons else MACHINE_PAGE
    if against is not None:
        maps = (*page.own.get(sections.learned_maps, ()), against.second_map)
        page = replace(page, own={**page.own, sections.learned_maps: maps})
    return fit_report(fit, page)
