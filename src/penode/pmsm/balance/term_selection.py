"""Structure by evidence: terms of the model that the recordings show and can identify."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.pmsm.balance.doubt import Doubt
from penode.pmsm.balance.term_evidence import Judged, judged
from penode.pmsm.balance.voltage_balance import BalanceForm, BalanceSolution, term_columns
from penode.pmsm.machine.dead_time import DeadTime, PhaseSigns
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.terms import ANGLE, Term

#: Harmonics of the electrical angle that a machine of three symmetric phases may have, each with
#: orders near it that such a machine cannot have: what they carry is chance.
_LOW, _HIGH = (5, 7, 8, 9, 10, 11, 13), (17, 19, 20, 22, 23, 25)
_HARMONICS = {6: _LOW, 12: _LOW, 18: _HIGH, 24: _HIGH}
#: Power of an order over the controls' median from which it is there.
_CLEAR = 20.0
#: Share of the low orders' power from which a high one is there: products of theirs carry less.
_PART = 0.01
#: Samples a period below which an order is not followed.
_SAMPLES = 4
#: Terms that are decided from the recordings, unless a study says otherwise.
CANDIDATES: tuple[Term, ...] = (DeadTime(),)


@dataclass(frozen=True, eq=False)
class Structure:
    """What a machine's model is made of beside the map of the currents.

    Attributes
    ----------
    terms : tuple of Term
        Of the voltage equation; resistance and rotation may be left unsaid.
    angle_orders : tuple of int
        Harmonics of the electrical angle in the map.
    term_reasons, angle_reasons : tuple of str
        Why, in sentences.
    doubts : tuple of Doubt
        What the recordings leave open.
    """

    terms: tuple[Term, ...]
    angle_orders: tuple[int, ...]
    term_reasons: tuple[str, ...]
    angle_reasons: tuple[str, ...]
    doubts: tuple[Doubt, ...] = ()


def structure_of(
    experiments: Sequence[Experiment],
    kind: str,
    terms: Sequence[Term] = (),
    candidates: Sequence[Term] = CANDIDATES,
) -> Structure:
    """Decide which terms the recordings show and can identify, before any training.

    A candidate is kept where the weak form of the voltage balance makes it more probable than not,
    and R and the map cannot stand in for it; what speaks for one that is left out stays as a doubt.
    An order of the angle is kept where it carries at least twenty times the power, in what that
    balance leaves over from sample to sample, of orders that a symmetric machine cannot have; 18
    and 24 where they also carry a hundredth of what 6 or 12 do.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s); without theta_el (rad)
        dead time is judged by its mean along the current, and harmonics cannot be.
    kind : str
        A key of `penode.pmsm.machine.flux_maps.FLUX_MAPS`.
    terms : sequence of Term
        Those that are certain; candidates of their roles are not tried.
    candidates : sequence of Term
        Those that may be added. Others of `CANDIDATES` are tried too where the harmonics are
        judged, as what they describe is no property of the map.

    Raises
    ------
    InputError
        If two terms have one role.
    """
    certain, found = tuple(terms), list[Judged]()
    wanted, taken = {c.role for c in candidates}, {term.role for term in terms}
    for term in (term for term in terms if is_open(term)):
        others = tuple(one for one in certain if one is not term)
        sized = judged(experiments, others, term, certain=True)
        certain = (*others, sized.term or term)
        found.append(sized)
    evident = certain
    balance = BalanceForm.of(experiments, True, certain).solve(experiments)
    unasked = [c for c in CANDIDATES if c.role not in wanted]
    for candidate in (c for c in (*candidates, *unasked) if c.role not in taken):
        one = judged(experiments, evident, candidate)
        if one.term is not None and one.balance is not None:
            evident, balance = (*evident, one.term), one.balance
        if candidate.role in wanted:
            found.append(one)
            certain = certain if one.term is None else (*certain, one.term)
    if all(ANGLE.name in e.channels for e in experiments):
        orders, why_orders = _orders(experiments, balance, kind)
    else:
        orders, why_orders = (), (f"Angle harmonics were left out: {ANGLE.name} was not recorded.",)
    doubts = tuple(doubt for one in found for doubt in one.doubts)
    return Structure(certain, orders, tuple(one.reason for one in found), why_orders, doubts)


def is_open(term: Term) -> bool:
    """Return whether something of a certain term is left to the recordings."""
    return isinstance(term, PhaseSigns) and term.dead_time_current is None


def _orders(
    experiments: Sequence[Experiment], balance: BalanceSolution, kind: str
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    power = order_power(experiments, balance, (*_HARMONICS, *_LOW, *_HIGH))
    largest = max(power[n] for n, beside in _HARMONICS.items() if beside is _LOW)
    floor, shown = dict[int, float](), list[int]()
    for n, beside in _HARMONICS.items():
        floor[n] = max(float(np.median([power[m] for m in beside])), 1e-300)
        least = _PART * largest if beside is _HIGH else 0.0
        if power[n] > max(_CLEAR * floor[n], least):
            shown.append(n)
    names = " and ".join(map(str, shown))
    if not shown:
        every = ", ".join(map(str, _HARMONICS))
        return (), (f"Angle harmonics were left out: none of the orders {every} stands out.",)
    if FLUX_MAPS[kind].draw_with_features is None:
        return (), (
            f"Angle harmonics {names} stand out and were left out: a {kind} map cannot follow the "
            "angle; coenergy, convex and mlp can.",
        )
    fastest = max(float(np.abs(e.channels["omega_el"]).max()) * e.time_step for e in experiments)
    kept = tuple(n for n in shown if _SAMPLES * n * fastest < 2 * np.pi)
    reasons = []
    if kept:
        named, times = (
            " and ".join(each)
            for each in (map(str, kept), (_rounded((power[n] / floor[n]) ** 0.5) for n in kept))
        )
        reasons.append(
            f"Angle harmonics were included: without them the residual's amplitudes at orders "
            f"{named} of the electrical frequency are {times} times those beside them."
        )
    missed = [n for n in shown if n not in kept]
    if missed:
        reasons.append(
            f"Angle harmonic {' and '.join(map(str, missed))} stands out and was left out: it is "
            f"sampled fewer than {_SAMPLES} times a period."
        )
    return kept, tuple(reasons)


def _rounded(ratio: float) -> str:
    """Return one digit of a ratio, thousands apart."""
    return f"{float(f'{ratio:.0e}'):,.0f}".replace(",", "\N{NO-BREAK SPACE}")


def order_power(
    experiments: Sequence[Experiment], balance: BalanceSolution, orders: Sequence[int]
) -> dict[int, float]:
    """Return the power of each order of the angle in what a balance leaves over, in V^2.

    Each order counts in both directions, with amplitudes quadratic in the currents, one for all
    stretches of a recording; summed over samples and recordings. The balance's map is averaged
    over the angle.
    """
    power = dict.fromkeys(orders, 0.0)
    for stretches in by_recording(experiments):
        parts = zip(*(_left_over(e, balance) for e in stretches), strict=True)
        left, theta_el, shapes = map(np.concatenate, parts)
        for order in orders:
            for sign in (1, -1):
                waves = shapes * np.exp(1j * sign * order * theta_el)[:, None]
                basis = np.linalg.qr(waves)[0]
                power[order] += float(np.sum(np.abs(basis.conj().T @ left) ** 2))
    return power


def _left_over(
    experiment: Experiment, balance: BalanceSolution
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what is left of each sample's voltage, d + j q (time - 1,), with angles and shapes."""
    currents, form = experiment.stack(CURRENTS), balance.form
    basis = form.polynomial.basis(currents)
    known_drop, by_parameter, by_psi = term_columns(experiment, balance.terms)
    psi = basis @ balance.mean
    induced = np.einsum("tij,tj->ti", by_psi, psi)
    drop = known_drop + by_parameter @ np.array([*balance.values.values()]) + induced
    rise = np.diff(_complex(psi)) / experiment.time_step
    left = _complex(experiment.stack(VOLTAGES)[:-1]) - _middle(_complex(drop)) - rise
    x, y = (_middle(currents) / form.polynomial.current_scale).T
    shapes = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    speed, theta_el = experiment.channels["omega_el"], experiment.channels["theta_el"]
    return left, theta_el[:-1] + 0.5 * experiment.time_step * _middle(speed), shapes


def _complex(vector: FloatArray) -> FloatArray:
    return np.asarray(vector[:, 0] + 1j * vector[:, 1])


def _middle(values: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (values[1:] + values[:-1]))
