"""Drift over a recording: resistance and magnets that change as the machine warms.

R + dR tau and psi_PM + dpsi tau, with tau from -1/2 at the beginning to 1/2 at the end, are
linear in dR and dpsi. They come from the voltage balance, one of each a recording, and what they
are is taken off the voltages: R and the map are those of the middle of the time. Stretches of one
recording share its clock.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.data.stretches import recording_numbers
from penode.horizon.uncertainty_budget import Imperfection
from penode.pmsm.balance.doubt import probability
from penode.pmsm.balance.equations import balance_equations, term_columns
from penode.pmsm.balance.polynomial_map import PolynomialMap
from penode.pmsm.balance.voltage_balance import harmonic_window
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES, less_voltage
from penode.pmsm.machine.term_registry import completed
from penode.pmsm.machine.terms import ANGLE, SPEED, TEMPERATURE, Resistance, Rotation, Term
from penode.training.weak_form import OVERLAP, WeakRegression, join

#: Share of R, and of the flux linkage, from which a drift matters, and up to which it is believed.
_MATTERS, _CREDIBLE = (2e-3, 2e-4), (0.6, 0.1)
#: Probability from which it is taken off: a drift that is not there may be one of something else.
_SURE = 0.99
#: The magnets' flux linkage lies along the d axis.
_ALONG_D = np.array([1.0, 0.0])
_REMEDY = "Record the winding's temperature, or at a steady one."


@dataclass(frozen=True)
class Drift:
    """What resistance and magnets change by from a recording's beginning to its end."""

    # One an experiment, ohm and Vs, 0 where none is taken into account; stretches have the whole's.
    resistance: tuple[float, ...] = ()
    magnet: tuple[float, ...] = ()
    # What both may change by beside that, in ohm and Vs: one standard deviation.
    left: tuple[float, float] = (0.0, 0.0)
    reasons: tuple[str, ...] = ()

    def applied(self, experiments: Sequence[Experiment]) -> list[Experiment]:
        """Return recordings with the voltages that a machine without the drift would have had."""
        values = zip(experiments, self.resistance, self.magnet, strict=True)
        return [_without(e, *of) for e, *of in values] if self.resistance else list(experiments)

    @property
    def imperfections(self) -> tuple[Imperfection, ...]:
        """What is not known of the drift, as rows of the uncertainty budget."""
        rows = []
        for source, unit, which in (("drift of R", "ohm", 0), ("drift of the magnets", "Vs", 1)):
            size = self.left[which]
            if size:
                applied = _Left(size * (which == 0), size * (which == 1))
                rows.append(Imperfection(source, f"{size:.2g} {unit}", _REMEDY, applied))
        return tuple(rows)


@dataclass(frozen=True)
class _Left:
    """Adds some standard deviations of a drift to a recording."""

    resistance: float
    magnet: float

    def __call__(self, experiment: Experiment, count: float) -> Experiment:
        return _without(experiment, count * self.resistance, count * self.magnet)


def drift_of(experiments: Sequence[Experiment], terms: Sequence[Term] = ()) -> Drift:
    """Estimate the drift of recordings.

    A dead time is allowed for where the angle was recorded. A term that follows the winding's
    temperature leaves no drift of R.
    """
    kinds = _kinds(terms)
    equations, first = _equations(experiments, terms)
    solution = equations.solve()
    count = len(equations.target) / OVERLAP
    sizes = abs(float(solution[first])), _largest_flux(experiments)
    changes, left, reasons = np.zeros((2, len(experiments))), [0.0, 0.0], list[str]()
    numbers = recording_numbers(experiments)
    each = [(kind, k) for kind in kinds for k in range(numbers.max() + 1)]
    for column, (kind, k) in enumerate(each):
        value, deviation = float(solution[column]), equations.deviation(column)
        matters, most = (limit[kind] * sizes[kind] for limit in (_MATTERS, _CREDIBLE))
        share = probability(value / max(deviation, 1e-300), count)
        unsure = math.sqrt(share) * math.hypot(value, deviation)
        if share > _SURE and matters < abs(value) < most:
            changes[kind, numbers == k], unsure = value, deviation
            name = experiments[int(np.argmax(numbers == k))].place.recording
            reasons.append(_sentence(name, kind, value, deviation, sizes[0]))
        left[kind] = max(left[kind], unsure if matters < unsure < most else 0.0)
    resistance, magnet = (tuple(row) for row in changes.tolist())
    return Drift(resistance, magnet, (left[0], left[1]), tuple(reasons))


def _equations(
    experiments: Sequence[Experiment], terms: Sequence[Term]
) -> tuple[WeakRegression, int]:
    """Return the balance with columns of the drifts first, and the place of the first parameter."""
    reach = max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)
    angle = all(ANGLE.name in e.channels for e in experiments)
    extra = (DeadTime(),) if angle and all(t.role != DeadTime.role for t in terms) else ()
    every = tuple(term.prepared(reach) for term in completed((*terms, *extra)))
    polynomial = PolynomialMap(True, reach)
    drifts = drift_columns(experiments, terms)
    rows = [
        balance_equations(e, every, polynomial.basis(e.stack(CURRENTS)), harmonic_window(e), own)
        for e, own in zip(experiments, drifts, strict=True)
    ]
    return join(rows), len(drifts[0])


def drift_columns(
    experiments: Sequence[Experiment], terms: Sequence[Term]
) -> list[list[tuple[FloatArray, FloatArray]]]:
    """Return stored and supplied quantity of the drifts, for `balance_equations`.

    For each experiment those of R, then of the magnets, of one recording after the other, shape
    (time, 2) each; without R's where a term follows the winding's temperature.
    """
    numbers = recording_numbers(experiments)
    return [
        [
            (stored * (k == place), supplied * (k == place))
            for stored, supplied in (_drift_columns(e, kind) for kind in _kinds(terms))
            for k in range(numbers.max() + 1)
        ]
        for place, e in zip(numbers, experiments, strict=True)
    ]


def _kinds(terms: Sequence[Term]) -> list[int]:
    return [1] if any(TEMPERATURE in term.channels for term in terms) else [0, 1]


def _drift_columns(experiment: Experiment, kind: int) -> tuple[FloatArray, FloatArray]:
    """Return stored and supplied quantity of a drift of R, or of the magnets, (time, 2) each."""
    tau = _tau(experiment)[:, None]
    stored = (0 * tau, tau)[kind] * _ALONG_D
    return stored, -tau * _drops(experiment)[kind]


def _without(experiment: Experiment, resistance: float, magnet: float) -> Experiment:
    if not (resistance or magnet):
        return experiment
    of_current, of_flux = _drops(experiment)
    rise = magnet / max(experiment.place.duration, 1e-300) * _ALONG_D
    steady = resistance * of_current + magnet * of_flux
    return less_voltage(experiment, _tau(experiment)[:, None] * steady + rise)


def _drops(experiment: Experiment) -> tuple[FloatArray, FloatArray]:
    """Return what one ohm, and one Vs of the magnets, drop of the voltage, (time, 2) each, in V."""
    _, by_resistance, by_psi = term_columns(experiment, (Resistance(), Rotation()))
    return by_resistance[..., 0], by_psi[..., 0]


def _tau(experiment: Experiment) -> FloatArray:
    """Return when each sample is on the clock of its recording, -1/2 to 1/2, (time,)."""
    place, length = experiment.place, (len(experiment) - 1) * experiment.time_step
    first, last = (
        t / max(place.duration, 1e-300) - 0.5 for t in (place.start, place.start + length)
    )
    return np.linspace(first, last, len(experiment))


def _largest_flux(experiments: Sequence[Experiment]) -> float:
    """Return about the largest flux linkage in Vs, from voltage over speed."""
    return max(
        float(np.median(np.hypot(*e.stack(VOLTAGES).T)))
        / max(float(np.median(np.abs(e.channels[SPEED.name]))), 1e-9)
        for e in experiments
    )


def _sentence(recording: str, kind: int, value: float, deviation: float, resistance: float) -> str:
    if kind == 1:
        return (
            f"{recording}: the magnets' flux linkage changes by {1e3 * value:.3g} ± "
            f"{1e3 * deviation:.2g} mVs over the recording; the map is that of its middle."
        )
    share, own = (100 * part / resistance for part in (value, deviation))
    return (
        f"{recording}: R changes by {share:.2g} ± {own:.1g} % over the recording; R is that "
        "of its middle."
    )
