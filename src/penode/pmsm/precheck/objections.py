"""Objections to a machine's fit: a convention, the voltage limit, per unit, an R too uncertain."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.fit.fit import Fit
from penode.fit.outcome import AGREED, NORMAL_95, Objection
from penode.horizon.held_out_check import validation_fails
from penode.horizon.objections import Check, recordings_trained_on
from penode.pmsm.conventions.agreement import disagreement_of
from penode.pmsm.conventions.broken_convention import BrokenConvention
from penode.pmsm.conventions.scales import PLATE
from penode.pmsm.machine.terms import Term
from penode.pmsm.recording.name_plate import NO_PLATE, NamePlate
from penode.pmsm.recording.stationary_frame import LINK
from penode.report.quantities import with_unit
from penode.validation.comparison import finite_residual

#: Fraction of the samples with the largest voltages, and how much larger their errors may be.
_TOP, _LARGER = 0.1, 3.0
_LINK_TOO = "Record u_dc beside, with which the samples at the limit are left out. "
#: Quantile of the squared errors that none of them counts above: one spike is no limiter.
_MOST = 0.999
#: A and V below which both currents and voltages look like fractions of a base.
_PER_UNIT = 2.5
#: Half width of the interval of R over R beyond which a recording does not determine it.
_WIDE = 0.1


def machine_checks(
    broken: Sequence[BrokenConvention] = (),
    unseen: Sequence[Experiment] = (),
    terms: Sequence[Term] = (),
    plate: NamePlate = NO_PLATE,
) -> tuple[Check, ...]:
    """Return what the fit of a machine is examined for.

    `broken` is of its recordings, where it was trained all the same; `unseen` are recordings that
    it predicts.
    """
    objections = [
        Objection(b.name, f"{b.recording}: {b.evidence}.", f"To fix it, {b.fix}.") for b in broken
    ]

    def broken_conventions(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        yield from objections

    def unseen_disagree(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        if not any(validation_fails(fit, experiments)):
            return
        names = {e.place.recording for e in unseen}
        for one in disagreement_of([*experiments, *unseen], terms):
            if one.recording in names:
                yield Objection(
                    one.name,
                    f"{one.recording}: {one.evidence}.",
                    f"{one.fix[0].upper()}{one.fix[1:]}.",
                )

    def name_plate(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        low, high = fit.parameters["R"].interval_95
        said = plate.resistance
        if said is not None and not (low < PLATE * said and high > said / PLATE):
            ratio = fit.parameters["R"].value / said
            yield Objection(
                "name plate",
                f"R is {ratio:.2f} times the {with_unit(said, 'ohm')} of the name plate.",
                "Check the plate and the scales of the channels, such as rms = true; R of the "
                "plate is that of one phase, as warm as recorded.",
            )

    return broken_conventions, per_unit, voltage_limit, name_plate, unseen_disagree


def per_unit(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where no current and no voltage is as large as those of a drive."""
    for stretches in by_recording(experiments):
        current, voltage = (
            max(float(np.abs(e.stack(names)).max()) for e in stretches)
            for names in (("i_d", "i_q"), ("u_d", "u_q"))
        )
        if max(current, voltage) < _PER_UNIT:
            yield Objection(
                "per unit",
                f"{stretches[0].place.recording}: no current is above {current:.2g} A and no "
                f"voltage above {voltage:.2g} V, as if they were given per unit.",
                "Add u_base and i_base, what 1 is in V and A, to the study file.",
            )


def voltage_limit(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where predictions err most at the largest voltages."""
    for whole, stretches, recorded in recordings_trained_on(fit, experiments):
        voltage = np.concatenate([np.hypot(*e.stack(("u_d", "u_q")).T)[:-1] for e in recorded])
        residual = np.concatenate([finite_residual(one) for one in stretches])
        squares = np.sum(residual**2, axis=1)
        squares = np.minimum(squares, np.quantile(squares, _MOST))
        above = voltage > np.quantile(voltage, 1 - _TOP)
        if not above.any():
            continue
        ratio = float(np.sqrt(squares[above].mean() / max(squares[~above].mean(), 1e-300)))
        if ratio > _LARGER:
            link = "" if LINK in recorded[0].channels else _LINK_TOO
            yield Objection(
                "voltage limit",
                f"{whole.name}: one-step errors are {ratio:.1f} times as large where the "
                f"voltage is above {voltage[above].min():.3g} V, as if a limiter acted that the "
                "recorded command does not show.",
                f"{link}Record the voltage behind the limiter, or stay below it.",
            )


def uncertain_resistance(fit: Fit) -> Fit:
    """Return the fit, not identifiable where its horizons agree on an R that nobody could use."""
    resistance = fit.parameters.get("R")
    if resistance is None or fit.horizon.verdict not in AGREED:
        return fit
    half = NORMAL_95 * resistance.std
    if half <= _WIDE * abs(resistance.value):
        return fit
    most = resistance.budget[0]
    reason = (
        f"R is determined to ± {with_unit(half, 'ohm', 2)} only, more than {100 * _WIDE:.0f} % of "
        f"its value; the largest contribution: {most.source}. {most.remedy}"
    )
    choice = replace(fit.horizon, verdict="not identifiable", reason=reason)
    return replace(fit, horizon=choice)
