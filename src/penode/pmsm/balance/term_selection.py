"""Structure by evidence: terms of the model that the recordings show and can identify."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.horizon.identifiability import THRESHOLD
from penode.pmsm.balance.equations import term_columns
from penode.pmsm.balance.voltage_balance import BalanceForm, BalanceSolution
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.term_registry import channels_of, physical_places
from penode.pmsm.machine.terms import ANGLE, DeadTime, Term

#: Harmonics of the electrical angle that a machine of three symmetric phases may have.
_HARMONICS = (6, 12)
#: Orders that it cannot have: what they carry is chance.
_CONTROLS = (5, 7, 8, 9, 10, 11, 13)
#: Power of an order over the controls' median from which it is there.
_CLEAR = 20.0
#: Deviations from which a term is there.
_SIGNIFICANT = 5.0
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
    """

    terms: tuple[Term, ...]
    angle_orders: tuple[int, ...]
    term_reasons: tuple[str, ...]
    angle_reasons: tuple[str, ...]


def structure_of(
    experiments: Sequence[Experiment],
    kind: str,
    terms: Sequence[Term] = (),
    candidates: Sequence[Term] = CANDIDATES,
) -> Structure:
    """Decide which terms the recordings show and can identify, before any training.

    A candidate is kept where the weak form of the voltage balance gives its parameter at five
    deviations at least, and R and the map cannot stand in for it. An order of the angle is kept
    where it carries at least twenty times the power, in what that balance leaves over from sample
    to sample, of orders that a symmetric machine cannot have.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s); without theta_el (rad)
        neither dead time nor harmonics can be judged.
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
    certain, reasons = tuple(terms), list[str]()
    wanted, taken = {c.role for c in candidates}, {term.role for term in terms}
    evident = certain
    balance = BalanceForm.of(experiments, True, certain).solve(experiments)
    others = [c for c in CANDIDATES if c.role not in wanted]
    for candidate in (c for c in (*candidates, *others) if c.role not in taken):
        kept, why, solution = _judged(experiments, evident, candidate)
        if kept and solution is not None:
            evident, balance = (*evident, candidate), solution
        if candidate.role in wanted:
            reasons.append(why)
            certain = (*certain, candidate) if kept else certain
    if all(ANGLE.name in e.channels for e in experiments):
        orders, why_orders = _orders(experiments, balance, kind)
    else:
        orders, why_orders = (), (f"Angle harmonics were left out: {ANGLE.name} was not recorded.",)
    return Structure(certain, orders, tuple(reasons), why_orders)


def _judged(
    experiments: Sequence[Experiment], terms: Sequence[Term], candidate: Term
) -> tuple[bool, str, BalanceSolution | None]:
    """Return whether a candidate is in beside terms, why, and the balance that has it."""
    title, needed = candidate.title, channels_of((candidate,))
    missing = next((n for e in experiments for n in needed if n not in e.channels), None)
    if missing is not None:
        return False, f"{title} was left out: {missing} was not recorded.", None
    balance = BalanceForm.of(experiments, True, (*terms, candidate)).solve(experiments)
    (_, name), *_ = physical_places((candidate,))
    value, deviation = balance.physical[name]
    shown = _with_deviation(value, deviation)
    if not abs(value) > _SIGNIFICANT * deviation:
        return False, f"{title} was left out: the voltage balance shows {shown} of it.", None
    if min(balance.independence.values()) < THRESHOLD:
        why = (
            f"{title} was left out: of one current amplitude its voltage ({shown}) cannot be "
            "distinguished from R; record several amplitudes."
        )
        return False, why, None
    return True, f"{title} was included: the voltage balance shows {shown} of it.", balance


def _orders(
    experiments: Sequence[Experiment], balance: BalanceSolution, kind: str
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    power = order_power(experiments, balance, (*_HARMONICS, *_CONTROLS))
    floor = max(float(np.median([power[n] for n in _CONTROLS])), 1e-300)
    shown = [n for n in _HARMONICS if power[n] > _CLEAR * floor]
    names = " and ".join(map(str, shown))
    if not shown:
        weak = " and ".join(map(str, _HARMONICS))
        return (), (f"Angle harmonics were left out: orders {weak} do not stand out.",)
    if FLUX_MAPS[kind].draw_with_features is None:
        return (), (
            f"Angle harmonics {names} stand out and were left out: a {kind} map cannot follow the "
            "angle; coenergy, convex and mlp can.",
        )
    fastest = max(float(np.abs(e.channels["omega_el"]).max()) * e.time_step for e in experiments)
    kept = tuple(n for n in shown if _SAMPLES * n * fastest < 2 * np.pi)
    reasons = []
    if kept:
        named = " and ".join(f"{n} ({_rounded(power[n] / floor)}-fold)" for n in kept)
        reasons.append(f"Angle harmonics were included: orders {named} stand out of the residual.")
    missed = [n for n in shown if n not in kept]
    if missed:
        reasons.append(
            f"Angle harmonic {' and '.join(map(str, missed))} stands out and was left out: it is "
            f"sampled fewer than {_SAMPLES} times a period."
        )
    return kept, tuple(reasons)


def _with_deviation(value: float, deviation: float) -> str:
    decimals = max(1 - math.floor(math.log10(max(deviation, 1e-6))), 0)
    return f"{round(value, decimals) + 0.0:.{decimals}f} ± {deviation:.{decimals}f} V"


def _rounded(ratio: float) -> str:
    """Return one digit of a ratio, thousands apart."""
    return f"{float(f'{ratio:.0e}'):,.0f}".replace(",", "\N{NO-BREAK SPACE}")


def order_power(
    experiments: Sequence[Experiment], balance: BalanceSolution, orders: Sequence[int]
) -> dict[int, float]:
    """Return the power of each order of the angle in what a balance leaves over.

    Parameters
    ----------
    experiments : sequence of Experiment
        With theta_el.
    balance : BalanceSolution
        Its map is averaged over the angle.
    orders : sequence of int
        Each in both directions, with amplitudes quadratic in the currents.

    Returns
    -------
    dict of int to float
        V^2, summed over samples and recordings.
    """
    power = dict.fromkeys(orders, 0.0)
    for experiment in experiments:
        left, theta_el, shapes = _left_over(experiment, balance)
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
