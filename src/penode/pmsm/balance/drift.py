"""Drift over a recording: resistance and magnets that change as the machine warms.

R + dR tau and psi_PM + dpsi tau, with tau from -1/2 at the beginning to 1/2 at the end, are
linear in dR and dpsi. They come from the voltage balance, one of each a recording, and what they
are is taken off the voltages: R and the map are those of the middle of the time. Stretches of one
recording share its clock.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from penode.data.experiment import Experiment
from penode.data.stretches import recording_numbers
from penode.pmsm.balance.doubt import probability
from penode.pmsm.balance.voltage_balance import BalanceForm
from penode.pmsm.machine.dead_time import DeadTime, MeanDeadTime
from penode.pmsm.machine.terms import ANGLE, MAGNETS, TEMPERATURE, Term
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE, Column, KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS
from penode.training.weak_form import OVERLAP

#: Probability from which it is taken off: a drift that is not there may be one of something else.
_SURE = 0.99


@dataclass(frozen=True)
class Drift:
    """What changes from a recording's beginning to its end."""

    # By name one an experiment, 0 where none is taken into account; stretches have the whole's.
    sizes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    # What each may change by beside that: one standard deviation.
    left: Mapping[str, float] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()

    def applied(self, experiments: Sequence[Experiment]) -> list[Experiment]:
        """Return recordings with the voltages that a machine without the drift would have had."""
        steady = list(experiments)
        for name, sizes in self.sizes.items():
            for place, size in enumerate(sizes):
                if size:
                    steady[place] = IMPERFECTIONS[name].corrected(
                        steady[place], size, UNKNOWN_DRIVE
                    )
        return steady


def drift_of(experiments: Sequence[Experiment], terms: Sequence[Term] = ()) -> Drift:
    """Estimate the drift of recordings.

    An inverter's voltage is allowed for. A term that follows the winding's
    temperature leaves no drift of R, one that follows the magnets' none of theirs.
    """
    angle = all(ANGLE.name in e.channels for e in experiments)
    inverter = DeadTime() if angle else MeanDeadTime()
    extra = (inverter,) if all(term.role != inverter.role for term in terms) else ()
    drifts = drift_columns(experiments, terms)
    form = BalanceForm.of(experiments, True, (*terms, *extra))
    equations = form.equations(experiments, further=drifts)
    solution, count = equations.solve(), len(equations.target) / OVERLAP
    drive = KnownDrive(float(solution[len(drifts[0])]))
    names, numbers = _drifting(terms), recording_numbers(experiments)
    changes, left = {name: np.zeros(len(experiments)) for name in names}, dict.fromkeys(names, 0.0)
    reasons = list[str]()
    each = [(name, k) for name in names for k in range(numbers.max() + 1)]
    for column, (name, k) in enumerate(each):
        one = IMPERFECTIONS[name]
        value, deviation = float(solution[column]), equations.deviation(column)
        matters, most = (limit * one.scale(experiments, drive) for limit in one.credible)
        share = probability(value / max(deviation, 1e-300), count)
        unsure = math.sqrt(share) * math.hypot(value, deviation)
        if share > _SURE and matters < abs(value) < most:
            changes[name][numbers == k], unsure = value, deviation
            recording = experiments[int(np.argmax(numbers == k))].place.recording
            reasons.append(f"{recording}: {one.sentence(value, deviation, drive)}")
        left[name] = max(left[name], unsure if matters < unsure < most else 0.0)
    sizes = {name: tuple(row.tolist()) for name, row in changes.items()}
    return Drift(sizes, left, tuple(reasons))


def drift_columns(experiments: Sequence[Experiment], terms: Sequence[Term]) -> list[list[Column]]:
    """Return the columns of the drifts: for each experiment those of one recording after the other.

    Those of R come first; a term that follows the winding's temperature leaves none.
    """
    numbers = recording_numbers(experiments)
    return [
        [
            (stored * (k == place), supplied * (k == place))
            for name in _drifting(terms)
            for stored, supplied in IMPERFECTIONS[name].columns(e, UNKNOWN_DRIVE)
            for k in range(numbers.max() + 1)
        ]
        for place, e in zip(numbers, experiments, strict=True)
    ]


def _drifting(terms: Sequence[Term]) -> list[str]:
    followed = {channel for term in terms for channel in term.channels}
    by = {"resistance_drift": TEMPERATURE, "magnet_drift": MAGNETS}
    drifts = [name for name, one in IMPERFECTIONS.items() if one.drifts]
    return [name for name in drifts if by.get(name) not in followed]
