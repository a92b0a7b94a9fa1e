"""Every solver converges at the order it claims, fed by exact history where it needs one."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from penode import Experiment, Model, physical
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.base import Predictor
from penode.predictors.holds import FirstOrderHold
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import ADAMS_BASHFORTH, RK3, RK4, RUNGE_KUTTA
from penode.validation.free_run import compare

SOLVERS = {
    **{table.name: RungeKutta(table) for table in RUNGE_KUTTA},
    **{table.name: AdamsBashforth(table) for table in ADAMS_BASHFORTH},
    "implicit midpoint": ImplicitMidpoint(),
    "trapezoidal": Trapezoidal(),
    "rk3 in 3 sub-steps": Substeps(RungeKutta(RK3), 3),
}
#: Steps over 2 s: fine enough for the leading term, coarse enough to stay above rounding.
STEPS = {1: (2000, 4000), 2: (160, 320), 3: (160, 320), 4: (120, 240), 5: (160, 320)}
START = (0.2, 0.1)
COARSE = {"dopri5": (60, 120)}


class Pendulum(Model):
    """Driven and damped: nonlinear in both states."""

    states = ("angle", "rate")
    inputs = ("push",)
    state_units = ("rad", "rad/s")

    gravity: object = physical("1/s2")

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0] - self.gravity * jnp.sin(x[0]) - 0.2 * x[1] ** 3])


def exact(push, steps, end=2):
    """Return the recording of steps + 1 samples over 2 s, or more, by an adaptive method."""

    def slope(t, x):
        return [x[1], push(t) - 2.0 * np.sin(x[0]) - 0.2 * x[1] ** 3]

    time = np.linspace(0, end, steps + 1)
    path = solve_ivp(
        slope, (0, end), list(START), t_eval=time, method="DOP853", rtol=1e-13, atol=1e-14
    ).y
    channels = {"angle": path[0], "rate": path[1], "push": push(time) + 0 * time}
    return Experiment("pendulum", end / steps, channels)


def error(solver, run, **options):
    found = compare(Predictor(run.time_step, solver, **options), Pendulum(2.0), run, "train")
    return np.abs(found.free_run - found.measured)[-1].max()


@pytest.mark.parametrize("name", SOLVERS)
def test_order_of_convergence(name):
    solver = SOLVERS[name]
    steps = COARSE.get(name, STEPS[solver.order])
    errors = [error(solver, exact(lambda t: 0.3, n)) for n in steps]
    assert errors[1] > 2e-13
    assert np.log2(errors[0] / errors[1]) == pytest.approx(solver.order, abs=0.1)


def test_a_first_order_hold_follows_a_ramp_that_a_zero_order_hold_cannot():
    """On an input that is straight between samples RK4 keeps its order with the second."""
    runs = [exact(lambda t: 0.3 + 0.5 * t, steps) for steps in (100, 200)]
    held = [error(RungeKutta(RUNGE_KUTTA[5]), run) for run in runs]
    straight = [error(RungeKutta(RUNGE_KUTTA[5]), run, hold=FirstOrderHold()) for run in runs]
    assert np.log2(held[0] / held[1]) == pytest.approx(1.0, abs=0.1)
    assert np.log2(straight[0] / straight[1]) == pytest.approx(4.0, abs=0.1)
    assert straight[1] < 1e-5 * held[1]


@pytest.mark.parametrize("solver", [RungeKutta(RK4), Substeps(RungeKutta(RK4), 2), Trapezoidal()])
def test_a_band_limited_hold_lets_every_solver_keep_its_order_on_sampled_sines(solver):
    """A straight one is of second order whatever the solver; the reference knows the sines."""
    runs = [exact(lambda t: 0.5 * np.sin(3 * t) + 0.3 * np.cos(5 * t), n, 15) for n in (300, 600)]
    errors = [error(solver, run, hold=BandLimitedHold()) for run in runs]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(solver.order, abs=0.15)
    if solver.order == 4:
        straight = [error(solver, run, hold=FirstOrderHold()) for run in runs]
        assert np.log2(straight[0] / straight[1]) == pytest.approx(2.0, abs=0.15)
        assert errors[1] < 1e-3 * straight[1]
