"""A step sees penalties as they are: held against a general minimiser of the whole loss."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from penode.training.gauss_newton_terms import GaussNewtonTerms
from penode.training.local_loss import LocalLoss
from penode.training.second_order import LevenbergMarquardt

VALUES, LIMITS, ROWS = 6, 20, 40


class Hinged:
    """Linear residuals beside squares of what linear combinations lack to their limits."""

    moving, windows = np.ones(VALUES, dtype=bool), None
    objective = SimpleNamespace(layout=SimpleNamespace(physical=()))

    def __init__(self, seed, weight):
        rng = np.random.default_rng(seed)
        self.slope = rng.normal(size=(ROWS, VALUES)) * np.logspace(0, -2, VALUES)
        self.target = self.slope @ rng.normal(size=VALUES) * 3 + rng.normal(size=ROWS)
        self.along = rng.normal(size=(LIMITS, VALUES))
        self.least = rng.normal(size=LIMITS)
        self.root = np.sqrt(weight)
        self.evaluations = 0

    def penalties(self, raw):
        lacking = self.root * (self.least - self.along @ raw)
        slopes = -self.root * self.along * (lacking > 0)[:, None]
        return np.maximum(lacking, 0.0), slopes

    def loss(self, raw):
        residual = self.target - self.slope @ raw
        return residual @ residual / ROWS + np.sum(self.penalties(raw)[0] ** 2)

    def gauss_newton(self, raw):
        self.evaluations += 1
        residual, (lacking, slopes) = self.target - self.slope @ raw, self.penalties(raw)
        normal = self.slope.T @ self.slope + ROWS * slopes.T @ slopes
        descent = self.slope.T @ residual - ROWS * slopes.T @ lacking
        return GaussNewtonTerms(self.loss(raw), ROWS, normal, descent, self.slope.T * residual)

    def reported_jacobian(self, raw):
        return np.empty((0, VALUES))

    def spread(self, step):
        return step

    def least_loss(self):
        found = minimize(self.loss, np.zeros(VALUES), method="BFGS", options={"gtol": 1e-9})
        again = minimize(self.loss, found.x, method="Powell", options={"ftol": 1e-14})
        return min(found.fun, again.fun)


@pytest.mark.parametrize("weight", [1e-2, 1.0, 1e4])
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_one_step_reaches_the_minimum_whatever_limits_it_crosses(seed, weight):
    problem = Hinged(seed, weight)
    start = np.random.default_rng(seed + 1).normal(size=VALUES) * 5
    solution = LevenbergMarquardt(4, damping=1e-12).minimise(problem, start)
    assert solution.terms.loss <= problem.least_loss() * (1 + 1e-6)
    assert problem.evaluations <= 4


@given(seed=st.integers(0, 2**32 - 1))
def test_what_a_step_promises_is_what_the_loss_does(seed):
    problem, rng = Hinged(seed, 1.0), np.random.default_rng(seed)
    raw, step = rng.normal(size=VALUES), rng.normal(size=VALUES)
    local = LocalLoss(problem, raw, problem.gauss_newton(raw))
    decrease = problem.loss(raw) - problem.loss(raw + step)
    assert local.promised(step) == pytest.approx(decrease, rel=1e-9, abs=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_a_damped_step_is_where_the_damped_loss_is_least(seed):
    """Sums of squares with the damping added: no way out of there lowers them."""
    problem, rng = Hinged(seed, 1.0), np.random.default_rng(seed)
    raw = rng.normal(size=VALUES) * 3
    terms = problem.gauss_newton(raw)
    held = 0.5 * np.diag(terms.normal)
    step = LocalLoss(problem, raw, terms).step(0.5)

    def damped(step):
        return ROWS * problem.loss(raw + step) + step @ (held * step)

    decrease = damped(np.zeros(VALUES)) - damped(step)
    best = minimize(damped, step, method="BFGS", options={"gtol": 1e-9}).fun
    assert damped(step) - best <= 2e-4 * decrease


def test_a_step_goes_on_along_a_limit_that_is_touched():
    """The steep limit leaves a hundred-millionth of the first step; the minimum is on its plane."""
    problem = Hinged(3, 1e8)
    free = np.linalg.lstsq(problem.slope, problem.target, rcond=None)[0]
    raw = free + 1.0
    problem.along[0] = raw - free  # the first step goes straight across
    problem.least = np.full(LIMITS, -1e9)
    problem.least[0] = problem.along[0] @ raw - 1e-8
    step = LocalLoss(problem, raw, problem.gauss_newton(raw)).step(1e-12)
    plane = np.linalg.svd(problem.along[:1])[2][1:].T
    on_it = (
        raw
        + plane
        @ np.linalg.lstsq(problem.slope @ plane, problem.target - problem.slope @ raw, rcond=None)[
            0
        ]
    )
    assert problem.loss(raw + step) <= problem.loss(on_it) * (1 + 1e-6)


def test_without_limits_near_it_is_the_damped_step_to_the_last_bit():
    problem = Hinged(3, 1.0)
    problem.least = np.full(LIMITS, -1e9)
    raw = np.ones(VALUES)
    terms = problem.gauss_newton(raw)
    scale = np.sqrt(np.diag(terms.normal))
    damped = terms.normal / np.outer(scale, scale) + 1e-3 * np.eye(VALUES)
    expected = np.linalg.solve(damped, terms.descent / scale) / scale
    np.testing.assert_array_equal(LocalLoss(problem, raw, terms).step(1e-3), expected)


def test_a_model_that_misfits_is_trained_to_its_minimum_too():
    """Deviations are as large as the misfit then, and what is reported seems to stand still."""

    class Misfit(Hinged):
        objective = SimpleNamespace(layout=SimpleNamespace(physical=("R",)))
        windows = SimpleNamespace(
            states=np.zeros(ROWS), starts=np.arange(ROWS), horizon=1, steps=np.ones(ROWS, dtype=int)
        )

        def reported_jacobian(self, raw):
            return np.eye(1, VALUES)

    problem = Misfit(5, 1.0)
    problem.target = problem.target + 30.0
    problem.least = np.full(LIMITS, -1e9)
    best = np.linalg.lstsq(problem.slope, problem.target, rcond=None)[0]
    start = best + np.linalg.lstsq(problem.slope, np.full(ROWS, 6.0), rcond=None)[0]
    assert problem.loss(start) > 1.002 * problem.loss(best)
    solution = LevenbergMarquardt(20, damping=30.0).minimise(problem, start)
    assert solution.converged
    assert solution.terms.loss < 1.0006 * problem.loss(best)
