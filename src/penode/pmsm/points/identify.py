"""From operating points to a machine."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import Delaunay, QhullError

from penode.arrays import FloatArray, one_blas_thread
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.fit.outcome import (
    IMPLAUSIBLE,
    NORMAL_95,
    Contribution,
    Estimate,
    HorizonChoice,
    Objection,
)
from penode.fit.provenance import provenance_of
from penode.models.layout import Layout
from penode.pmsm.balance.spline_start import reach
from penode.pmsm.balance.start import round_scale
from penode.pmsm.machine.coenergy_map import CoenergySplines
from penode.pmsm.machine.dead_time import MeanDeadTime, PhaseSigns
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.term_registry import (
    channels_of,
    completed,
    physical_values,
    with_physical,
)
from penode.pmsm.machine.terms import SPEED, Term
from penode.pmsm.points.balance import (
    PointsBalance,
    PointsSolution,
    Solved,
    contributions,
    left_out,
    mixed,
)
from penode.pmsm.points.recorded_torque import TorqueBalance
from penode.pmsm.recording.drive_mapping import TORQUE
from penode.pmsm.study_settings import DEFAULT_STUDY, Study
from penode.validation.comparison import StationaryComparison

#: Verdict of points that answer.
ANSWERED = "operating points"
#: Parts of a triangle's side at which currents between points are taken for visited.
_FINE = 6
#: From so much beside 1 on a torque is another than the map's: no sensor is as wrong.
_TORQUE_OFF = 0.1
#: From so many points on they may be a recording.
_MANY = 1000
#: Widths of the inverter's knee over the largest current, one as likely as the other.
_KNEES = (0.01, 0.03, 0.1, 0.2)


@one_blas_thread
def identify_points(points: Experiment, study: Study = DEFAULT_STUDY) -> Fit:
    """Identify the resistance and the flux-linkage map of a machine from operating points.

    Parameters
    ----------
    points : Experiment
        A sample a point: u_d, u_q (V), i_d, i_q (A), omega_el (rad/s), and torque (Nm) of the
        shaft if it was measured. The time step means nothing.
    study : Study
        Terms, accuracy of the bench and pole pairs; the map is ``coenergy``.

    Returns
    -------
    Fit
        Without horizon (``fit.horizon.selected`` is 0) and with ``fit.stationary``.

    Raises
    ------
    InputError
        If a channel that a term needs is missing, or the torque is measured and the pole pairs
        are missing.
    """
    began = time.monotonic()
    balances = balances_of(points, study)
    solved = [one.solve() for one in balances]
    best = min(range(len(solved)), key=lambda k: solved[k].solution.evidence)
    balance, solution = balances[best], mixed(one.solution for one in solved)
    machine = _machine(balance, solution)
    estimates = _estimates(balance, solution)
    stationary = _comparison(balance, solved[best])
    choice = _choice(balance, estimates, machine)
    facts = {**study.facts([points], ()), **_found(balance, solution)}
    provenance = {**provenance_of([points]), "training_time_s": time.monotonic() - began, **facts}
    return Fit(
        model=machine,
        parameters=estimates,
        horizon=choice,
        excited=_between(points.stack(CURRENTS)),
        comparisons=(),
        stationary=stationary,
        learned_uncertainty=_uncertainty(balance, solution, machine),
        provenance=provenance,
        warnings=tuple(_notes(points, study, estimates)),
    )


def _notes(points: Experiment, study: Study, estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield what points cannot show, and what is unusual about what they show."""
    if len(points) > _MANY:
        yield (
            f"{points.name}: {len(points)} rows without a time are taken as operating points; if "
            "this is a recording, give time_step, or the column of t."
        )
    if study.pole_pairs and SPEED.name in study.of_shaft:
        beside = ", and the torque is the same with any" if TORQUE in points.channels else ""
        yield (
            f"pole_pairs = {study.pole_pairs} is taken as given: the speed is that of the shaft, "
            f"so that psi, L_d and L_q are as 1/pole_pairs{beside}."
        )
    inverter = estimates.get("inverter_voltage")
    if inverter is not None and inverter.interval_95[1] < 0:
        yield (
            "inverter_voltage is negative: the drive compensates for more than its inverter takes "
            "of the voltage."
        )


def balances_of(points: Experiment, study: Study) -> list[PointsBalance]:
    """Return the balance with each width of the inverter's knee, which few points show."""
    _require_values(points)
    largest = float(np.abs(points.stack(CURRENTS)).max())
    if TORQUE in points.channels and study.pole_pairs is None:
        raise InputError(
            f"{points.name}: the torque is measured and pole_pairs is missing; add --pole-pairs "
            f"({_likely_pole_pairs(points, study)} would fit), or remove the column."
        )
    fixed = tuple(term for term in study.terms if not isinstance(term, PhaseSigns))
    known = any(term.role == MeanDeadTime.role for term in fixed)
    # What an inverter takes of each phase is, on average at a point, a voltage along the current.
    asked = len(fixed) < len(study.terms)
    left_open = any(term.role == MeanDeadTime.role for term in study.candidates)
    knees: Sequence[tuple[Term, ...]] = [
        (MeanDeadTime(knee_current=knee * largest),) for knee in _KNEES
    ]
    if known or not (asked or left_open):
        knees = [()]
    speed = np.abs(points.channels[SPEED.name])
    turning = speed > 0.1 * speed.max()
    induced = np.hypot(*points.stack(VOLTAGES)[turning].T) / speed[turning]
    scales = (reach([points]), round_scale(float(induced.max())))
    balances = []
    for knee in knees:
        terms = tuple(term.prepared(largest) for term in completed((*fixed, *knee)))
        for name, channel in channels_of(terms).items():
            if name not in points.channels:
                raise InputError(
                    f"{points.name}: no column {name}, {channel.meaning}, which a term needs; add "
                    "it, or leave the term out."
                )
        balances.append(PointsBalance(points, terms, study.accuracy, study.pole_pairs, scales))
    return balances


def _require_values(points: Experiment) -> None:
    """Refuse points at which a quantity is zero throughout."""
    for names in (CURRENTS, VOLTAGES, (SPEED.name,), (TORQUE,)):
        if names[0] in points.channels and not np.any(points.stack(names)):
            what = " and ".join(names)
            remedy = "remove the column" if names[0] == TORQUE else "check the columns"
            raise InputError(
                f"{points.name}: {what} must differ from 0 at some point, got 0 at all of "
                f"{len(points)}; {remedy}."
            )


def _between(currents: FloatArray) -> FloatArray:
    """Return currents (point, 2) with some between neighbours, where a smooth map interpolates."""
    try:
        corners = currents[Delaunay(currents).simplices]
    except QhullError:  # all on a line
        return currents
    shares = np.array([(a, b, _FINE - a - b) for a in range(_FINE) for b in range(_FINE - a)])
    between = np.einsum("sk,tkj->tsj", shares / _FINE, corners).reshape(-1, 2)
    return np.concatenate([currents, between])


def _machine(balance: PointsBalance, solution: PointsSolution) -> Machine:
    count, outer = len(balance.names), len(physical_values(balance.terms))
    table = solution.mean[count:].reshape(balance.part.coefficients.shape)
    splines = CoenergySplines((replace(balance.part, coefficients=table),))
    return Machine(
        FluxMap(splines, *balance.scales), with_physical(balance.terms, solution.mean[:outer])
    )


def _estimates(balance: PointsBalance, solution: PointsSolution) -> dict[str, Estimate]:
    layout: Layout[Machine] = Layout(_machine(balance, solution))
    settings = dict(zip(layout.names, layout.settings, strict=True))
    places = [balance.names.index(name) for name in balance.imperfections]
    estimates = {}
    for k, name in enumerate(physical_values(balance.terms)):
        parts, rest = contributions(solution.covariance, k, places)
        rows = [Contribution("noise of the points", rest)]
        for part, (name_of, (one, own)) in zip(parts, balance.imperfections.items(), strict=True):
            said = one.said(own), one.remedy, balance.accuracy.origin(name_of)
            rows.append(Contribution(one.source, abs(float(part)), *said))
        rows.sort(key=lambda row: -row.std)
        std = float(np.sqrt(solution.covariance[k, k]))
        setting = settings[name]
        value = float(solution.mean[k])
        estimates[name] = Estimate.of(value, std, setting.unit, None, setting.meaning, tuple(rows))
    return estimates


def _comparison(balance: PointsBalance, solved: Solved) -> StationaryComparison:
    """Return the points beside what the most likely noise and knee say of them."""
    matrix, solution = solved.matrix, solved.likeliest
    deviation = np.ones(len(balance.target))
    for rows, own in zip(balance.outputs, solution.noise, strict=True):
        deviation[rows] = own
    fitted = matrix @ solution.mean
    without, spread = left_out(matrix, balance.target, solution, deviation)
    return as_measured(balance, fitted, without, spread)


def as_measured(
    equations: PointsBalance | TorqueBalance,
    fitted: FloatArray,
    without: FloatArray,
    spread: FloatArray,
) -> StationaryComparison:
    """Return what is fitted of equations, and what is without each, beside what was measured."""

    def table(values: FloatArray) -> FloatArray:
        return np.column_stack([values[rows] for rows in equations.outputs])

    known = equations.known
    return StationaryComparison(
        equations.title,
        tuple(equations.quantities),
        tuple(equations.quantities.values()),
        states=equations.at,
        measured=table(equations.target + known),
        fitted=table(fitted + known),
        without=table(without + known),
        deviation=table(spread),
    )


def _uncertainty(
    balance: PointsBalance, solution: PointsSolution, machine: Machine
) -> LearnedUncertainty:
    layout: Layout[Machine] = Layout(machine)
    raw = layout.raw(machine)
    covariance = np.zeros((layout.size, layout.size))
    learned = np.flatnonzero(layout.members(("learned",)))
    first = len(balance.names)
    covariance[np.ix_(learned, learned)] = solution.covariance[first:, first:]
    return LearnedUncertainty(covariance, raw[None], np.ones(1))


def _choice(
    balance: PointsBalance, estimates: dict[str, Estimate], machine: Machine
) -> HorizonChoice:
    resistance = estimates["R"]
    low, high = resistance.interval_95
    value = 1e3 * resistance.value
    half = 1e3 * NORMAL_95 * resistance.std
    count, speeds = len(balance.points), balance.points.channels[SPEED.name]
    about = f"{count} operating points"
    about += " with their torque" if balance.torque else " without torque"
    if high < 0 or not _definite(machine, balance.points):
        what = (
            f"R of {value:.3g} ± {half:.2g} mΩ is below zero"
            if high < 0
            else "the differential inductance is not positive"
        )
        objection = Objection(
            "impossible value",
            f"From {about}: {what}.",
            "Check signs and units of the columns, and whether voltages are measured or commanded.",
        )
        return HorizonChoice(0, IMPLAUSIBLE, objection.reason, (), objections=(objection,))
    if off := _another_torque(machine, balance):
        objection = Objection("torque", f"From {about}: {off[0]}", off[1])
        return HorizonChoice(0, IMPLAUSIBLE, objection.reason, (), objections=(objection,))
    if low <= 0:
        more = "points at a tenth of the speed"
        more += "" if balance.torque else ", and the torque"
        reason = (
            f"From {about} R is {value:.3g} ± {half:.2g} mΩ, which may be zero: measure {more}."
        )
        return HorizonChoice(0, "not identifiable", reason, ())
    spread = np.ptp(np.abs(speeds)) / np.abs(speeds).max()
    at = "at several speeds" if spread > 0.2 else "at one speed"
    return HorizonChoice(0, ANSWERED, f"From {about}, {at}.", ())


def _another_torque(machine: Machine, balance: PointsBalance) -> tuple[str, str] | None:
    """Return what is wrong with a torque that is not that of the map, and how to fix it."""
    if not balance.torque or balance.pole_pairs is None:
        return None
    points, pairs = balance.points, balance.pole_pairs
    found, deviation = _torque_over_map(machine, points)
    if abs(found / pairs - 1) < max(_TORQUE_OFF, NORMAL_95 * deviation / pairs):
        return None
    near = max(1, round(abs(found)))
    return (
        f"the torque is {found / pairs:.2g} times 1.5 p (psi_d i_q - psi_q i_d) with p = {pairs}.",
        f"Check the pole pairs ({near} would fit), and sign and unit of the torque.",
    )


def _torque_over_map(machine: Machine, points: Experiment) -> tuple[float, float]:
    """Return the torque beside friction over that of one pole pair, and its deviation."""
    (i_d, i_q), measured = points.stack(CURRENTS).T, points.channels[TORQUE]
    psi_d, psi_q = machine.maps()["flux_map"](i_d, i_q)
    friction = -np.sign(points.channels[SPEED.name])
    columns = np.stack([1.5 * (psi_d * i_q - psi_q * i_d), friction], axis=1)
    found = np.linalg.lstsq(columns, measured, rcond=None)[0]
    left = np.var(measured - columns @ found) * np.linalg.pinv(columns.T @ columns)[0, 0]
    return float(found[0]), float(np.sqrt(left))


def _likely_pole_pairs(points: Experiment, study: Study) -> int:
    """Return the pole pairs with which the torque is most nearly that of the voltages' map."""
    silent = {name: one for name, one in points.channels.items() if name != TORQUE}
    machine = identify_points(replace(points, channels=silent), study).model
    assert isinstance(machine, Machine)
    return max(1, round(abs(_torque_over_map(machine, points)[0])))


def _definite(machine: Machine, points: Experiment) -> bool:
    """Return whether the differential inductance is positive definite at the points."""
    inductance = machine.maps()["differential_inductance"](*points.stack(CURRENTS).T)
    return bool(np.linalg.eigvalsh(np.moveaxis(inductance, -1, 0)).min() > 0)


def _found(balance: PointsBalance, solution: PointsSolution) -> dict[str, Any]:
    """Return what else was found, for the provenance."""
    deviations = np.sqrt(np.diag(solution.covariance))
    found: dict[str, Any] = {"operating_points": len(balance.points)}
    found["noise"] = _in_words(solution.noise)
    if balance.torque:
        at = balance.names.index("friction_torque")
        half = NORMAL_95 * deviations[at]
        found["friction_torque"] = f"{solution.mean[at]:.3g} ± {half:.2g} Nm"
    return found


def _in_words(noise: Sequence[float] | FloatArray) -> str:
    return ", ".join(
        f"{one:.2g} {unit}" for one, unit in zip(noise, ("V", "V", "Nm"), strict=False)
    )
