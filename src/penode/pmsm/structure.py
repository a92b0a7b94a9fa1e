"""Structure by evidence: terms of the model that the recordings show and can identify."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.horizon.identifiability import THRESHOLD
from penode.pmsm.flux_maps import FLUX_MAPS
from penode.pmsm.frames import abc_from_dq, dq_from_abc
from penode.pmsm.weak_balance import BalanceForm, BalanceSolution, PolynomialMap

#: Harmonics of the electrical angle that a machine of three symmetric phases may have.
CANDIDATES = (6, 12)
#: Orders that it cannot have: what they carry is chance.
_CONTROLS = (5, 7, 8, 9, 10, 11, 13)
#: Power of an order over the controls' median from which it is there.
_CLEAR = 20.0
#: Deviations from which the dead-time voltage is there.
_SIGNIFICANT = 5.0
#: Samples a period below which an order is not followed.
_SAMPLES = 4
#: Guess of i_0, the current below which dead time costs less, as a share of the largest current.
DEAD_TIME_CURRENT = 0.01


@dataclass(frozen=True)
class Structure:
    """What a machine's model is made of beside R and the map of the currents.

    Attributes
    ----------
    inverter : bool
        Whether the dead-time voltage is among the parameters.
    angle_orders : tuple of int
        Harmonics of the electrical angle in the map.
    inverter_reasons, angle_reasons : tuple of str
        Why, in sentences.
    """

    inverter: bool
    angle_orders: tuple[int, ...]
    inverter_reasons: tuple[str, ...]
    angle_reasons: tuple[str, ...]


def structure_of(experiments: Sequence[Experiment], kind: str) -> Structure:
    """Decide which terms the recordings show and can identify, before any training.

    The inverter's term is kept where the weak form of the voltage balance finds a dead-time
    voltage of at least five deviations that R and the map cannot stand in for. An order of the
    angle is kept where it carries at least twenty times the power, in what that balance leaves
    over from sample to sample, of orders that a symmetric machine cannot have.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s); without theta_el (rad) no
        term can be told.
    kind : str
        A key of `penode.pmsm.flux_maps.FLUX_MAPS`.
    """
    if not all("theta_el" in e.channels for e in experiments):
        missing = "left out: theta_el was not recorded."
        return Structure(
            False, (), (f"Dead time was {missing}",), (f"Angle harmonics were {missing}",)
        )
    scale = max(float(np.abs(e.stack(("i_d", "i_q"))).max()) for e in experiments)
    polynomial = PolynomialMap(True, scale)
    whole = BalanceForm(polynomial, dead_time_current=DEAD_TIME_CURRENT * scale).solve(experiments)
    inverter, why_inverter = _inverter(whole)
    balance = whole if inverter else BalanceForm(polynomial).solve(experiments)
    orders, why_orders = _orders(experiments, balance, kind)
    return Structure(inverter, orders, (why_inverter,), why_orders)


def _inverter(balance: BalanceSolution) -> tuple[bool, str]:
    found, deviation = balance.dead_time_voltage, balance.deviation["dead_time_voltage"]
    told = _with_deviation(found, deviation)
    if not abs(found) > _SIGNIFICANT * deviation:
        return False, f"Dead time was left out: the voltage balance shows {told} of it."
    if min(balance.independence.values()) < THRESHOLD:
        return False, (
            f"Dead time was left out: of one current amplitude its voltage ({told}) cannot be told "
            "from R; record several amplitudes."
        )
    return True, f"Dead time was included: the voltage balance shows {told} of it."


def _orders(
    experiments: Sequence[Experiment], balance: BalanceSolution, kind: str
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    power = order_power(experiments, balance, (*CANDIDATES, *_CONTROLS))
    floor = max(float(np.median([power[n] for n in _CONTROLS])), 1e-300)
    shown = [n for n in CANDIDATES if power[n] > _CLEAR * floor]
    names = " and ".join(map(str, shown))
    if not shown:
        weak = " and ".join(map(str, CANDIDATES))
        return (), (f"Angle harmonics were left out: orders {weak} do not stand out.",)
    if FLUX_MAPS[kind].draw_with_features is None:
        return (), (
            f"Angle harmonics {names} stand out and were left out: a {kind} map cannot follow the "
            "angle; coenergy can.",
        )
    fastest = max(float(np.abs(e.channels["omega_el"]).max()) * e.time_step for e in experiments)
    kept = tuple(n for n in shown if _SAMPLES * n * fastest < 2 * np.pi)
    reasons = []
    if kept:
        told = " and ".join(f"{n} ({_rounded(power[n] / floor)}-fold)" for n in kept)
        reasons.append(f"Angle harmonics were included: orders {told} stand out of the residual.")
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
    drive = experiment.stack(("i_d", "i_q", "u_d", "u_q", "omega_el", "theta_el"))
    currents, theta_el, form = drive[:, :2], drive[:, 5], balance.form
    dropped = balance.resistance * currents
    if form.dead_time_current is not None:
        signs = np.tanh(abc_from_dq(currents, theta_el) / form.dead_time_current)
        dropped = dropped + balance.dead_time_voltage * dq_from_abc(signs, theta_el)
    psi = form.polynomial.basis(currents) @ balance.mean
    speed = drive[:, 4]
    induced = 1j * _middle(speed) * _middle(_complex(psi))
    rise = np.diff(_complex(psi)) / experiment.time_step
    left = _complex(drive[:-1, 2:4]) - _middle(_complex(dropped)) - induced - rise
    x, y = (_middle(currents) / form.polynomial.current_scale).T
    shapes = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    return left, theta_el[:-1] + 0.5 * experiment.time_step * _middle(speed), shapes


def _complex(vector: FloatArray) -> FloatArray:
    return np.asarray(vector[:, 0] + 1j * vector[:, 1])


def _middle(values: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (values[1:] + values[:-1]))
