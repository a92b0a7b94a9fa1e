"""Adams-Bashforth against a hand-written recursion, implicit steps against their own equations."""

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Model, Predictor, physical
from penode.arrays import float64
from penode.data.experiment import Experiment
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import Substeps
from penode.predictors.tableaus import AB2, ADAMS_BASHFORTH, AdamsBashforthTable
from penode.validation.free_run import compare

STEP, SAMPLES = 0.05, 90


class Oscillator(Model):
    states = ("x", "v")
    inputs = ("u",)
    state_units = ("m", "m/s")

    k: object = physical("1/s2")
    c: object = physical("1/s")

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] ** 3 - self.c * x[1]])


def slope(k, c, x, u):
    return np.stack([x[1], u - k * x[0] ** 3 - c * x[1]])


@pytest.fixture(scope="module")
def run():
    random = np.random.default_rng(5)
    time = STEP * np.arange(SAMPLES)
    path = np.stack([np.sin(time), np.cos(time)]) + 0.01 * random.normal(size=(2, SAMPLES))
    return Experiment("run", STEP, {"x": path[0], "v": path[1], "u": random.normal(size=SAMPLES)})


@pytest.mark.parametrize("table", ADAMS_BASHFORTH, ids=lambda t: t.name)
def test_free_run_from_measured_history_is_the_recursion_by_hand(table, run):
    found = compare(Predictor(STEP, AdamsBashforth(table)), Oscillator(1.3, 0.2), run, "train")
    measured, u = run.stack(("x", "v")), run.channels["u"]
    path = [*measured[: table.order]]
    for n in range(table.order - 1, SAMPLES - 1):
        slopes = [slope(1.3, 0.2, path[n - j], u[n - j]) for j in range(table.order)]
        path.append(path[n] + STEP * sum(b * f for b, f in zip(table.b, slopes, strict=True)))
    np.testing.assert_allclose(found.free_run, path, rtol=0, atol=1e-12)


def test_weights_that_are_no_quadrature_are_refused():
    with pytest.raises(ValueError, match="moment 1"):
        AdamsBashforthTable("wrong", (0.5, 0.5))


@pytest.mark.parametrize("solver", [ImplicitMidpoint(), Trapezoidal()], ids=["midpoint", "trapez"])
def test_implicit_steps_solve_their_equations(solver, run):
    ahead = compare(Predictor(STEP, solver), Oscillator(1.3, 0.2), run, "train").one_step[1:].T
    before, u = run.stack(("x", "v"))[:-1].T, run.channels["u"][:-1]
    if isinstance(solver, ImplicitMidpoint):
        right = before + STEP * slope(1.3, 0.2, 0.5 * (before + ahead), u)
    else:
        ends = slope(1.3, 0.2, before, u) + slope(1.3, 0.2, ahead, u)
        right = before + 0.5 * STEP * ends
    np.testing.assert_allclose(ahead, right, rtol=0, atol=1e-13)


def test_implicit_midpoint_stays_stable_on_a_stiff_system(run):
    stiff = Oscillator(1.0, 1e4)
    implicit = compare(Predictor(STEP, ImplicitMidpoint()), stiff, run, "train")
    assert implicit.free_run_errors["x"] < 10
    assert compare(Predictor(STEP), stiff, run, "train").diverged


def test_sub_steps_need_a_one_step_solver():
    with pytest.raises(ValueError, match="one-step"):
        Substeps(AdamsBashforth(AB2), 2)


def test_float64_is_kept(run):
    with float64():
        start = jnp.asarray(run.stack(("x", "v"))[:1].T)[None]
        step = Predictor(STEP, ImplicitMidpoint()).step
        assert step(Oscillator(1.0, 1.0), start, lambda offset: jnp.ones((1, 1))).dtype == "float64"
