"""Start by the weak form: splines by penalised least squares; for other maps a polynomial map.

To the polynomial map a draw of the wanted map is fitted.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from penode.arrays import FloatArray, JaxArray, float64
from penode.data.experiment import Experiment
from penode.models.compositions import LinearSkip
from penode.models.layout import Layout
from penode.models.networks import TanhLayers
from penode.pmsm.balance.knee import spread_over_knees
from penode.pmsm.balance.spline_start import reach, spline_start
from penode.pmsm.balance.voltage_balance import BalanceForm, BalanceSolution
from penode.pmsm.machine.flux_maps import FLUX_MAPS, FluxMap, draw_flux_map
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance, Term
from penode.training.penalties import Penalty

#: Maps drawn, of which the better after a few evaluations is fitted to the end.
_DRAWS, _FEW, _MANY = 2, 20, 100
_POINTS = 200
#: What an estimate of the weak form may be wrong by in addition to its deviation, as a fraction:
#: it integrates between samples by the trapezoidal rule.
_ANCHOR_BIAS = 0.01
#: Weights of the differential inductance and of the slope over the angle beside the flux linkage,
#: all scaled to order 1.
_SLOPE_WEIGHT = 0.1
_ANGLE_WEIGHT = 0.05
#: What a random network's last layer begins with, beside the linear map.
_WEAK = 0.05


class WeakStart(NamedTuple):
    """A machine started by the weak form."""

    machine: Machine
    # With a polynomial map: estimates without training, their deviations.
    balance: BalanceSolution
    # What the weak form knows of the map's smoothness, for training.
    penalties: tuple[Penalty, ...] = ()


def weak_start(
    experiments: Sequence[Experiment],
    kind: str,
    seed: int = 0,
    *,
    angle_orders: tuple[int, ...] = (),
    terms: Sequence[Term] = (),
) -> WeakStart:
    """Find physical parameters and flux map by the weak form.

    A map of splines follows by penalised least squares. For any other a polynomial map does, to
    which a draw of the map is fitted.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s).
    kind : str
        A key of `penode.pmsm.machine.flux_maps.FLUX_MAPS`.
    seed : int
        Seed of the draws, of which the better of two is kept; a map of splines draws
        nothing.
    angle_orders : tuple of int
        Harmonics of the electrical angle in the map.
    terms : sequence of Term
        Of the voltage equation; resistance and rotation may be left unsaid.

    Returns
    -------
    WeakStart
    """
    currents = np.concatenate([e.stack(Machine.states) for e in experiments])
    family = FLUX_MAPS[kind]
    orders = angle_orders if family.drawn else ()
    form = BalanceForm.of(experiments, family.reciprocal, terms, orders)
    balance = form.solve(experiments)
    points = currents[np.linspace(0, len(currents) - 1, _POINTS).round().astype(int)]
    largest = float(np.abs(balance.flux(points, np.zeros(len(points)))[0]).max())
    if not family.drawn:
        scales = (reach(experiments), round_scale(largest))
        splines = spline_start(experiments, form.terms, scales, angle_orders)
        return WeakStart(splines.machine, balance, splines.penalties)
    scales = (round_scale(form.polynomial.current_scale), round_scale(largest))
    draws = [draw_flux_map(kind, seed + k, scales, angle_orders) for k in range(_DRAWS)]
    flux_map = _fit_networks(draws, balance, points, np.random.default_rng(seed))
    return WeakStart(Machine(flux_map, balance.terms), balance)


def anchor_of(
    experiments: Sequence[Experiment], balance: BalanceSolution
) -> dict[str, tuple[float, float]]:
    """Return what a balance of recordings says of physical parameters, and how far that is sure.

    Beside its deviation counts what the trapezoidal rule may be wrong by, and what a balance with
    dead time owes to the knee that it is given.
    """
    form = balance.form
    spread = spread_over_knees(experiments, form.polynomial.reciprocal, form.terms)
    return {
        name: (value, math.hypot(deviation, _ANCHOR_BIAS * value, spread.get(name, 0.0)))
        for name, (value, deviation) in balance.physical.items()
    }


def nominal_start(experiments: Sequence[Experiment], seed: int) -> Machine:
    """Put a weak random network beside the machine's linear map, with an R drawn at random.

    The start of the paper's recipe: without the linear part random weights make the differential
    inductance singular, and every rollout overflows at once.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s); they give the magnet's flux
        linkage and the two inductances.
    seed : int
        Seed of the draw of the network, 2-6-4-2 with tanh, and of R, uniform in 0 to 20 mohm.
    """
    balance = BalanceForm.of(experiments, True, degree=2).solve(experiments)
    scale = balance.form.polynomial.current_scale
    origin = np.zeros((1, 2))
    psi, inductance, _ = (part[0] for part in balance.flux(origin, np.zeros(1)))
    largest = float(np.abs(psi).max() + scale * np.abs(inductance).max())
    drawn = TanhLayers.random((2, 6, 4, 2), seed)
    *hidden, last = drawn.weights
    *inner, bias = drawn.biases
    network = TanhLayers((*hidden, _WEAK * last), (*inner, _WEAK * bias))
    beside = LinearSkip(network, inductance * scale / largest, psi / largest)
    resistance = np.random.default_rng(seed).uniform(0.0, 0.02)
    return Machine(FluxMap(beside, scale, largest), (Resistance(resistance),))


def round_scale(largest: float) -> float:
    """Return a scale of a tenth of a decade that holds a value.

    Scales are constants of the compiled programs: recordings that share them share the programs.
    """
    return float(f"{10 ** (math.ceil(10 * math.log10(largest) - 1e-9) / 10):.3g}")


def _six_digits(values: FloatArray) -> FloatArray:
    """Round to six significant digits: a hundred steps blow up the last bits of a recording."""
    size = 10.0 ** np.floor(np.log10(np.maximum(np.abs(values), 1e-300)))
    return np.asarray(np.round(values / size, 5) * size)


def _fit_networks(
    draws: Sequence[FluxMap],
    balance: BalanceSolution,
    points: FloatArray,
    random: np.random.Generator,
) -> FluxMap:
    """Fit draws to the balance's map at points (point, 2) in A, each at an angle of its own.

    Flux linkage, inductance and slope over the angle are fitted; the best draw's map is kept.
    """
    layout: Layout[FluxMap] = Layout(draws[0])
    theta_el = random.uniform(0.0, 2 * np.pi, len(points))
    flux, slopes, turning = balance.flux(points, theta_el)
    wanted = (points.T, theta_el, flux.T, slopes.transpose(1, 2, 0), turning.T)
    scale = draws[0].current_scale

    def residual(raw: JaxArray, *wanted: JaxArray) -> JaxArray:
        at, theta_el, flux, slopes, turning = wanted
        predicted = layout.model(layout.values(raw)[:, None]).at_angle(at, theta_el)
        errors = (
            predicted.linkage - flux,
            _SLOPE_WEIGHT * scale * (predicted.inductance - slopes),
            _ANGLE_WEIGHT * (predicted.angle_slope - turning),
        )
        return jnp.concatenate([error.ravel() for error in errors]) / draws[0].flux_scale

    with float64():
        value, jacobian = jax.jit(residual), jax.jit(jax.jacfwd(residual))
        how: dict[str, Any] = {"jac": jacobian, "args": wanted, "method": "lm"}
        tried = [least_squares(value, layout.raw(d), max_nfev=_FEW, **how) for d in draws]
        better = min(tried, key=lambda fit: float(fit.cost))
        best = least_squares(value, better.x, max_nfev=_MANY, **how)
        return layout.plain_model(_six_digits(best.x))
