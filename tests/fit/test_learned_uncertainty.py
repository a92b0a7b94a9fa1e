"""The deviation of a learned map against the closed form of a map linear in its parameters."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from penode import Experiment, Fit, Model, ladder_plan
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.horizon.ladder import LadderProblem
from penode.models.polynomials import Polynomial
from penode.training.covariance import sandwich
from penode.training.second_order import LevenbergMarquardt


class Tank(Model):
    """x' = u - f(x), f a learned cubic."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    outflow: Polynomial

    def derivative(self, x, u):
        return u.values - self.learned(x)

    def learned(self, x):
        return self.outflow.value_and_jacobian(x)[0]


POINTS = np.linspace(-1.0, 2.0, 7)[:, None]
POWERS = POINTS ** np.arange(4)


@pytest.fixture
def tank():
    return Tank(Polynomial(1, 3, np.array([[0.1, 0.5, -0.2, 0.05]])))


def test_it_is_the_quadratic_form_of_the_covariance(tank, rng):
    root = rng.normal(size=(4, 4))
    agreeing = tank.outflow.coefficients
    told = LearnedUncertainty(root @ root.T, agreeing, np.ones(1))
    wanted = np.linalg.norm(POWERS @ root, axis=1)
    np.testing.assert_allclose(told.deviation(tank, POINTS)[:, 0], wanted, rtol=1e-10)


def test_horizons_that_differ_add_their_weighted_spread(tank):
    shift = np.array([0.0, 0.3, 0.0, -0.1])
    agreeing = tank.outflow.coefficients + np.outer([1.0, 0.0], shift)
    told = LearnedUncertainty(np.zeros((4, 4)), agreeing, np.array([0.25, 0.75]))
    wanted = np.abs(POWERS @ shift) * np.sqrt(0.25 * 0.75)
    np.testing.assert_allclose(told.deviation(tank, POINTS)[:, 0], wanted, atol=1e-12)


def test_the_slope_along_a_direction_has_its_own(tank, rng):
    root, shift = rng.normal(size=(4, 4)), np.array([0.0, 0.3, 0.0, -0.1])
    agreeing = tank.outflow.coefficients + np.outer([1.0, 0.0], shift)
    told = LearnedUncertainty(root @ root.T, agreeing, np.array([0.25, 0.75]))
    slopes = np.arange(4) * POINTS ** np.maximum(np.arange(4) - 1, 0)
    spread = np.abs(slopes @ shift) * np.sqrt(0.25 * 0.75)
    wanted = 2.0 * np.hypot(np.linalg.norm(slopes @ root, axis=1), spread)
    of_slope = told.deviation(tank, POINTS, np.array([2.0]))[:, 0]
    np.testing.assert_allclose(of_slope, wanted, rtol=1e-10)


def test_recordings_too_short_to_tell_give_infinity(tank):
    told = LearnedUncertainty(np.full((4, 4), np.inf), tank.outflow.coefficients, np.ones(1))
    assert np.isinf(told.deviation(tank, POINTS)).all()
    assert np.isinf(told.deviation(tank, POINTS, np.ones(1))).all()


@pytest.mark.slow
def test_stated_deviations_are_those_of_repeated_experiments(tank):
    """Sixty recordings with noise on every step, H = 3; their errors in deviations have size 1."""
    step, count, random = 0.05, 2000, np.random.default_rng(11)
    plan = ladder_plan((3,), LevenbergMarquardt(tolerance=0.01))
    drive = 0.4 + 0.9 * np.sin(np.arange(count) * 0.11) + 0.5 * np.sin(np.arange(count) * 0.037)
    true = tank.outflow.coefficients[0]
    problem, errors = None, []
    for _ in range(60):
        x = np.zeros(count)
        for k in range(count - 1):
            x[k + 1] = _advanced(true, x[k], drive[k], step) + 0.01 * random.normal()
        run = Experiment("run.csv", step, {"x": x, "u": drive})
        problem = problem or LadderProblem.of(tank, [run], plan, lambda event: None)
        rung = (
            replace(problem, experiments=[run])
            .climb(plan, problem.objective.layout.raw(tank))
            .fits[0]
        )
        covariance = sandwich(rung.solution.terms, rung.series)
        told = LearnedUncertainty(covariance, rung.solution.raw[None], np.ones(1))
        points = np.quantile(x, [0.1, 0.3, 0.5, 0.7, 0.9])[:, None]
        found = np.polynomial.polynomial.polyval(points[:, 0], rung.solution.raw - true)
        errors.append(found / told.deviation(rung.model, points)[:, 0])
    size = np.sqrt(np.mean(np.square(errors), axis=0))
    # Sixty repetitions know it to 9 %.
    assert (size > 0.75).all()
    assert (size < 1.35).all()


def _advanced(coefficients, x, u, step):
    def slope(x):
        return u - np.polynomial.polynomial.polyval(x, coefficients)

    a = slope(x)
    b = slope(x + step / 2 * a)
    c = slope(x + step / 2 * b)
    return x + step / 6 * (a + 2 * b + 2 * c + slope(x + step * c))


def test_a_fit_keeps_it(oscillator, tmp_path):
    fit = oscillator.fit
    deviation = fit.learned_deviation(fit.excited)
    assert deviation.shape == (len(fit.excited), 1)
    assert (deviation > 0).all()
    assert np.median(deviation) < 0.1 * np.ptp(fit.spring(fit.excited[:, 0]))
    fit.save(tmp_path)
    again = Fit.load(tmp_path).learned_deviation(fit.excited)
    np.testing.assert_allclose(again, deviation, rtol=1e-12)
