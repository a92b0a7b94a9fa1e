"""Prefilters against SciPy; weighted, filtered and flux residuals against a NumPy twin.

The model is a coil with saturation: what it stores, psi(i), depends on trained parameters, so that
the measured side of the residual does too.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

from penode import Experiment, InputError, Jittered, Model, Predictor, physical
from penode.arrays import Leaf, float64
from penode.data.windows import cut
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.gauss_newton_terms import residual_scale
from penode.training.loss import (
    Discounted,
    Loss,
    Prefilter,
    channel_deviation,
    equation,
    every_step,
    increment_deviation,
    last_step,
)
from penode.training.residuals import Objective

pytestmark = pytest.mark.usefixtures("quickly_compiled")

STEP, HORIZON = 0.05, 6
TRUTH = np.array([0.8, 0.2, 0.7, 0.5])
SCALE = np.array([0.5, 2.0])

FILTERS = {
    "none": Prefilter(),
    "gain": Prefilter((0.3,)),
    "fir": Prefilter((1.0, -0.5, 0.2)),
    "iir": Prefilter((0.4,), (1.0, -0.8, 0.3)),
    "longer above": Prefilter((1.0, 0.5, -0.2, 0.1), (1.0, -0.6)),
    "longer below": Prefilter((0.7, 0.5), (1.0, -0.6, 0.2, -0.1)),
}


# --- prefilters -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILTERS)
def test_prefilter_is_scipys_from_rest(name, rng):
    prefilter, signal = FILTERS[name], rng.normal(size=(20, 2, 3))
    expected = lfilter(prefilter.numerator, prefilter.denominator, signal, axis=0)
    found = []
    with float64():
        memory = jnp.zeros((prefilter.order, 2, 3))
        for sample in jnp.asarray(signal):
            filtered, memory = prefilter.advance(memory, sample)
            found.append(filtered)
    assert memory.shape == (prefilter.order, 2, 3)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("above", "below"), [((), (1.0,)), ((1.0,), ()), ((1.0,), (2.0, 0.1)), ((1.0,), (0.0,))]
)
def test_a_filter_that_is_none_is_refused(above, below):
    with pytest.raises(InputError, match="denominator that begins with 1"):
        Prefilter(above, below)


# --- the residual -----------------------------------------------------------------------------


class Coil(Model):
    """dpsi/dt = u - R i with psi = L i + M (i_q, i_d) + S tanh(i)."""

    states: ClassVar[tuple[str, ...]] = ("i_d", "i_q")
    inputs: ClassVar[tuple[str, ...]] = ("u_d", "u_q")
    state_units: ClassVar[tuple[str, ...]] = ("A", "A")

    L: Leaf = physical("H")
    M: Leaf = physical("H")
    S: Leaf = physical("Vs")
    R: Leaf = physical("ohm")

    def derivative(self, x, u):
        d, q = self.L + self.S * (1 - jnp.tanh(x) ** 2)
        v = u.values - self.R * x
        rates = [q * v[0] - self.M * v[1], d * v[1] - self.M * v[0]]
        return jnp.stack(rates) / (d * q - self.M**2)

    def stored(self, x):
        return self.L * x + self.M * x[::-1] + self.S * jnp.tanh(x)


def psi(raw, x):
    return raw[0] * x + raw[1] * x[::-1] + raw[2] * np.tanh(x)


def slope(raw, x, u):
    d, q = raw[0] + raw[2] / np.cosh(x) ** 2
    v = u - raw[3] * x
    return np.stack([q * v[0] - raw[1] * v[1], d * v[1] - raw[1] * v[0]]) / (d * q - raw[1] ** 2)


@pytest.fixture(scope="module")
def windows():
    """Return 25 windows."""
    random, time = np.random.default_rng(3), np.arange(150)
    waves = [np.sin(2 * np.pi * time / p) for p in (31, 47, 23, 60)]
    noisy = np.array(waves) + 0.1 * random.normal(size=(4, 150))
    run = Experiment("coil.csv", STEP, dict(zip(("i_d", "i_q", "u_d", "u_q"), noisy, strict=True)))
    return cut([run], Coil.states, Coil.inputs, HORIZON, placement=Jittered(1))


def explicit(windows, loss, weights):
    """Return the residual (step, state, window) and J, one complex step a parameter."""
    raw = TRUTH[:, None, None] + 1e-30j * np.eye(4)[:, :, None]
    x, rows = windows.states.T[:, None, windows.starts] + np.zeros((1, 4, 1)), []
    for k in range(HORIZON):
        x = x + STEP * slope(raw, x, windows.inputs.T[:, None, windows.starts + k])
        measured = windows.states.T[:, None, windows.starts + k + 1] + np.zeros((1, 4, 1))
        gap = psi(raw, measured) - psi(raw, x) if loss.domain is equation else measured - x
        rows.append(np.sqrt(weights[k]) * gap / SCALE[:, None, None])
    below, above = loss.prefilter.denominator, loss.prefilter.numerator
    filtered = lfilter(above, below, rows, axis=0)
    return filtered[:, :, 0].real, np.moveaxis(filtered.imag / 1e-30, 2, -1).reshape(-1, 4)


#: Loss, and the weight of every step written out.
LOSSES = {
    "discounted": (Loss(weight=Discounted(0.5)), [1, 1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32]),
    "all at once": (
        Loss(equation, Discounted(1.5), FILTERS["longer below"]),
        [1, 1.5, 1.5**2, 1.5**3, 1.5**4, 1.5**5],
    ),
    "all at once, longer above": (
        Loss(equation, last_step, FILTERS["longer above"]),
        [0, 0, 0, 0, 0, 6],
    ),
}


@pytest.mark.parametrize(
    "name",
    [
        "discounted",
        pytest.param("all at once", marks=pytest.mark.slow),
        "all at once, longer above",
    ],
)
def test_gauss_newton_terms_and_gradient_are_those_of_the_explicit_residual(name, windows):
    loss, weights = LOSSES[name]
    residual, jacobian = explicit(windows, loss, weights)
    objective = Objective(Predictor(STEP, RungeKutta(EULER)), Coil(*TRUTH), SCALE, loss)
    terms = objective.gauss_newton(TRUTH, windows)
    expected = jacobian.T @ jacobian
    assert terms.count == residual.size
    assert terms.loss == pytest.approx(np.mean(residual**2), rel=1e-12)
    np.testing.assert_allclose(terms.normal, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    descent = -jacobian.T @ residual.ravel()
    np.testing.assert_allclose(terms.descent, descent, rtol=0, atol=1e-11 * np.abs(descent).max())
    np.testing.assert_allclose(terms.scores.sum(axis=1), terms.descent, rtol=1e-12, atol=1e-12)
    value, gradient = objective.loss_and_gradient(TRUTH, windows)
    assert value == pytest.approx(terms.loss, rel=1e-12)
    expected = -2 * descent / residual.size
    np.testing.assert_allclose(gradient, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("weight", [every_step, last_step, Discounted(1.0)])
def test_constant_errors_weigh_the_same_over_the_whole_horizon(weight):
    total = sum(float(weight(jnp.asarray(k), jnp.asarray(9))) for k in range(1, 10))
    assert total == pytest.approx(9)


# --- its scale --------------------------------------------------------------------------------


class CoilInUnits(Coil):
    state_units: ClassVar[tuple[str, ...]] = ("A", "mA")


def test_scale_is_the_deviation_of_what_is_compared_where_units_differ(rng):
    visited = rng.normal(size=(40, 2)) * [1.0, 3.0]
    in_states = residual_scale(CoilInUnits(*TRUTH), visited, Loss())
    np.testing.assert_allclose(in_states, visited.std(axis=0), rtol=1e-12)
    in_psi = residual_scale(CoilInUnits(*TRUTH), visited, Loss(equation))
    np.testing.assert_allclose(in_psi, psi(TRUTH, visited.T).std(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(residual_scale(Coil(*TRUTH), visited, Loss(equation)), [1, 1])


def test_scales_by_channel_and_by_increment():
    visited = np.cumsum(np.random.default_rng(3).normal(size=(500, 2)) * [2.0, 0.1], axis=0)
    coil = Coil(*TRUTH)
    by_channel = residual_scale(coil, visited, Loss(scale=channel_deviation))
    np.testing.assert_allclose(by_channel, np.std(visited, axis=0), rtol=1e-12)
    by_increment = residual_scale(coil, visited, Loss(scale=increment_deviation))
    np.testing.assert_allclose(by_increment, [2.0, 0.1], rtol=0.1)
