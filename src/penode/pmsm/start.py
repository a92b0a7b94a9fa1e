"""Convex start: resistance and a polynomial flux map by the weak form, then a network fit to it."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from penode.arrays import FloatArray, JaxArray, float64
from penode.data.experiment import Experiment
from penode.models.parameters import Layout
from penode.pmsm.flux_maps import FLUX_MAPS, FluxMap
from penode.pmsm.model import Machine
from penode.training.weak_form import WeakRegression, join, weak_regression

#: Degree of the polynomial coenergy, and of the polynomials of a map without coenergy.
_DEGREE = {True: 8, False: 6}
_DRAWS = 2
_POINTS = 200
#: Weight of the differential inductance beside the flux linkage, both scaled to order 1.
_SLOPE_WEIGHT = 0.1


@dataclass(frozen=True, eq=False)
class PolynomialMap:
    """Flux map that is linear in its coefficients, on currents scaled to the unit disc.

    Attributes
    ----------
    reciprocal : bool
        Gradient of a polynomial coenergy, or two free polynomials.
    current_scale : float
        A (peak).
    """

    reciprocal: bool
    current_scale: float

    def basis(self, currents: FloatArray) -> FloatArray:
        """Return the map of each coefficient, shape (time, 2, coefficient), at (time, 2) in A."""
        x, y = (currents / self.current_scale).T
        degree = _DEGREE[self.reciprocal]
        powers = [(m, n) for m in range(degree + 1) for n in range(degree + 1 - m)]
        if self.reciprocal:
            columns = [
                (m * x ** max(m - 1, 0) * y**n, n * x**m * y ** max(n - 1, 0))
                for m, n in powers
                if m + n > 0
            ]
        else:
            zero = np.zeros_like(x)
            columns = [(x**m * y**n, zero) for m, n in powers]
            columns += [(zero, x**m * y**n) for m, n in powers]
        return np.stack([np.stack(column, axis=1) for column in columns], axis=2)


def weak_start(
    experiments: Sequence[Experiment], kind: str, seed: int = 0
) -> tuple[Machine, float]:
    """Find resistance and flux map by convex steps.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s).
    kind : str
        A key of `penode.pmsm.flux_maps.FLUX_MAPS`.
    seed : int
        Seed of the network draws; the best of two is kept.

    Returns
    -------
    Machine
        Resistance and fitted network.
    float
        Share of the resistance's low-passed regressor that the map's regressors do not explain.
    """
    currents = np.concatenate([e.stack(Machine.states) for e in experiments])
    scale = float(np.abs(currents).max())
    polynomial = PolynomialMap(FLUX_MAPS[kind].reciprocal, scale)
    regression = join([_equations(e, polynomial) for e in experiments])
    solution = regression.solve()
    points = currents[:: max(len(currents) // _POINTS, 1)]
    flux = polynomial.basis(points) @ solution[1:]
    step = 1e-4 * scale
    shifts = [np.array([step, 0.0]), np.array([0.0, step])]
    slopes = [
        (polynomial.basis(points + d) - polynomial.basis(points - d)) @ solution[1:] / (2 * step)
        for d in shifts
    ]
    largest = float(np.abs(flux).max())
    draws = [FluxMap(FLUX_MAPS[kind].draw(seed + k), scale, largest) for k in range(_DRAWS)]
    flux_map = _fit_networks(draws, points, flux, np.stack(slopes, axis=2))
    return Machine(flux_map, R=solution[0]), regression.independence(0)


def _equations(experiment: Experiment, polynomial: PolynomialMap) -> WeakRegression:
    """Weak form of d psi/dt = u - R i - omega J psi; the first coefficient is R."""
    currents = experiment.stack(Machine.states)
    drive = experiment.stack(Machine.inputs)
    basis = polynomial.basis(currents)
    rotation = drive[:, 2, None, None] * np.stack([-basis[:, 1], basis[:, 0]], axis=1)
    stored = np.concatenate([np.zeros_like(currents)[..., None], basis], axis=2)
    supplied = np.concatenate([-currents[..., None], -rotation], axis=2)
    length = harmonic_window(experiment)
    return weak_regression(stored, supplied, drive[:, :2], experiment.time_step, length)


def harmonic_window(experiment: Experiment) -> int:
    """Return two periods of the sixth electrical harmonic in samples (8 to an eighth of the run).

    A Hann window of this length nulls the orders 6, 12, 18, ... of slotting and dead time.
    """
    speed = float(np.median(np.abs(experiment.channels["omega_el"])))
    longest = max((len(experiment) - 1) // 8, 1)
    turns = max(speed * experiment.time_step / (2 * np.pi), 1 / (3 * longest))
    return int(np.clip(round(1 / (3 * turns)), min(8, longest), longest))


def _fit_networks(
    draws: Sequence[FluxMap], points: FloatArray, flux: FloatArray, slopes: FloatArray
) -> FluxMap:
    """Fit flux (point, 2) in Vs and its Jacobian (point, 2, 2) in H; keep the best draw's map."""
    layout = Layout(draws[0])
    flux_scale, current_scale = draws[0].flux_scale, draws[0].current_scale

    def residual(raw: JaxArray) -> JaxArray:
        fitted = layout.model(layout.values(raw)[:, None])
        psi, inductance = fitted.flux_and_inductance(jnp.asarray(points.T))
        flux_error = (psi - flux.T) / flux_scale
        slope_error = (inductance - slopes.transpose(1, 2, 0)) * current_scale / flux_scale
        return jnp.concatenate([flux_error.ravel(), _SLOPE_WEIGHT * slope_error.ravel()])

    with float64():
        value, jacobian = jax.jit(residual), jax.jit(jax.jacfwd(residual))
        fits = [
            least_squares(value, layout.raw(draw), jac=jacobian, method="lm", max_nfev=100)
            for draw in draws
        ]
        best = min(fits, key=lambda fit: float(fit.cost))
        return layout.plain_model(best.x)
