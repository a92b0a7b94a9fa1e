"""Objections to the fit of a machine: a broken convention, the voltage limit, per unit."""

from collections.abc import Iterator, Sequence

import numpy as np

from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.outcome import Objection
from penode.horizon.objections import Check, finite_residual, trained_on
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.conventions.check import check_all
from penode.pmsm.recording.stationary_frame import LINK

#: Fraction of the samples with the largest voltages, and how much larger their errors may be.
_TOP, _LARGER = 0.1, 3.0
_LINK_TOO = "Record u_dc beside, with which the samples at the limit are left out. "
#: Quantile of the squared errors that none of them counts above: one spike is no limiter.
_MOST = 0.999
#: A and V below which both currents and voltages look like fractions of a base.
_PER_UNIT = 2.5


def machine_checks(
    experiments: Sequence[Experiment],
    calibration: Calibration = AS_RECORDED,
    pole_pairs: int | None = None,
) -> tuple[Check, ...]:
    """Return what the fit of a machine is examined for.

    Parameters
    ----------
    experiments : sequence of Experiment
        As a study file maps them; their conventions are tested here, once.
    calibration : Calibration
        Of their channels.
    pole_pairs : int, optional
        Of the machine.
    """
    broken = [b for one in check_all(experiments, calibration, pole_pairs) for b in one.broken]
    objections = [
        Objection(b.name, f"{b.recording}: {b.evidence}.", f"To mend it, {b.mend}.") for b in broken
    ]

    def broken_conventions(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        yield from objections

    return broken_conventions, per_unit, voltage_limit


def per_unit(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where no current and no voltage is as large as those of a drive."""
    for experiment in experiments:
        current, voltage = (
            float(np.abs(experiment.stack(names)).max())
            for names in (("i_d", "i_q"), ("u_d", "u_q"))
        )
        if max(current, voltage) < _PER_UNIT:
            yield Objection(
                "per unit",
                f"{experiment.name}: no current is above {current:.2g} A and no voltage above "
                f"{voltage:.2g} V, as if they were given per unit.",
                "Give u_base and i_base, what 1 is in V and A, in the study file.",
            )


def voltage_limit(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where predictions err most at the largest voltages."""
    for comparison, experiment in trained_on(fit, experiments):
        voltage = np.hypot(*experiment.stack(("u_d", "u_q")).T)[:-1]
        squares = np.sum(finite_residual(comparison) ** 2, axis=1)
        squares = np.minimum(squares, np.quantile(squares, _MOST))
        above = voltage > np.quantile(voltage, 1 - _TOP)
        if not above.any():
            continue
        ratio = float(np.sqrt(squares[above].mean() / max(squares[~above].mean(), 1e-300)))
        if ratio > _LARGER:
            link = "" if LINK in experiment.channels else _LINK_TOO
            yield Objection(
                "voltage limit",
                f"{comparison.name}: one-step errors are {ratio:.1f} times as large where the "
                f"voltage is above {voltage[above].min():.3g} V, as if a limiter acted that the "
                "recorded command does not show.",
                f"{link}Record the voltage behind the limiter, or stay below it.",
            )
