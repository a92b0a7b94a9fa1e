"""Noise on the measured start biases a rate by 3 / (2 H + 1) of what it does at H = 1.

sum k / sum k^2 over k = 1 .. H, as long as H steps are short against the time constant.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Contiguous, Experiment, Model, Predictor, physical
from penode.arrays import Leaf
from penode.data.windows import cut
from penode.training.covariance import Reported
from penode.training.loss import DEFAULT_LOSS, Loss
from penode.training.plan import Problem
from penode.training.residuals import Objective
from penode.training.second_order import LevenbergMarquardt

SAMPLES, STEP = 16_000, 1e-3


class Lag(Model):
    """x' = b u - a x."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("K",)

    a: Leaf = physical("1/s")
    b: Leaf = physical("K/s")

    def derivative(self, x, u):
        return jnp.stack([self.b * u[0] - self.a * x[0]])


def recordings():
    """Record a lag of 1 s twice, with noise of opposite signs: what is linear in it cancels."""
    random, time = np.random.default_rng(2), STEP * np.arange(SAMPLES)
    u = 2.0 * np.sin(1.9 * time) + 1.5 * np.sin(0.7 * time + 1.0)
    decay, x = np.exp(-STEP), np.zeros(SAMPLES)
    for k in range(SAMPLES - 1):
        x[k + 1] = decay * x[k] + (1 - decay) * u[k]
    noise = 0.02 * random.normal(size=SAMPLES)
    return [Experiment(f"{sign:+}", STEP, {"x": x + sign * noise, "u": u}) for sign in (1, -1)]


def errors(horizons, loss=DEFAULT_LOSS):
    """Return the error of a by horizon."""
    objective = Objective(Predictor(STEP), Lag(1.0, 1.0), np.ones(1), loss)
    reported = Reported(objective.layout, np.zeros((1, 1)))
    runs, moving, found = recordings(), np.ones(2, dtype=bool), {}
    for horizon in horizons:
        windows = cut(runs, ("x",), ("u",), horizon, placement=Contiguous())
        problem = Problem(objective, reported, windows, moving)
        solution = LevenbergMarquardt(tolerance=1e-6).minimise(problem, np.ones(2))
        found[horizon] = solution.raw[0] - 1.0
    return found


@pytest.fixture(scope="module")
def bias():
    """Return the error of a at H = 1, 2, 4, 8."""
    return errors((1, 2, 4, 8))


def test_noise_on_the_start_biases_the_rate(bias):
    """The variance of the noise over that part of the signal's that the input does not explain."""
    signal = np.mean([run.stack(("x", "u")) for run in recordings()], axis=0)
    own = 1 / np.linalg.inv(signal.T @ signal / SAMPLES)[0, 0]
    assert bias[1] > 0.1
    assert bias[1] == pytest.approx(4e-4 / own / STEP, rel=0.05)


@pytest.mark.parametrize("horizon", [2, 4, 8])
def test_bias_falls_as_three_over_two_h_plus_one(bias, horizon):
    assert bias[horizon] / bias[1] == pytest.approx(3 / (2 * horizon + 1), rel=0.1)


@pytest.mark.parametrize("horizon", [8, 40])
def test_a_start_that_its_window_estimates_biases_nothing(bias, horizon):
    """The noise is that of an output then, at every sample alike."""
    held = bias[1] * 3 / (2 * horizon + 1)
    found = errors((horizon,), Loss(free_starts={"x": np.inf}))[horizon]
    assert held > 0.02
    assert abs(found) < 0.01 * held
