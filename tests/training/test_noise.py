"""Noise with outliers: the likelihood and its scale against SciPy, curvatures against differences.

A tank drains by a root of its level; the twin is written out in NumPy.
"""

from dataclasses import replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import t as students_t

from penode import Experiment, InputError, Jittered, Model, Predictor, identify, physical
from penode.arrays import float64
from penode.data.windows import cut
from penode.engine import StudentT, default_plan
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.chunks import summed
from penode.training.covariance import Reported
from penode.training.loss import Loss
from penode.training.moments import moments
from penode.training.noise_scale import with_scale
from penode.training.plan import Problem
from penode.training.residuals import Objective

pytestmark = pytest.mark.usefixtures("quickly_compiled")

STEP, HORIZON, NU, NOISE = 0.05, 6, 4.0, 0.01
TRUTH = np.array([0.8, 0.5])
SCALES = np.array([0.012, 0.009])


class Tanks(Model):
    """Two tanks in a row, both levels measured."""

    states: ClassVar = ("upper", "lower")
    inputs: ClassVar = ("inflow",)
    state_units: ClassVar = ("m", "m")

    first: object = physical("1/s")
    second: object = physical("1/s")

    def derivative(self, x, u):
        between = self.first * jnp.sqrt(jnp.abs(x[0]))
        return jnp.stack([u[0] - between, between - self.second * jnp.sqrt(jnp.abs(x[1]))])


def slope(raw, x, inflow):
    between = raw[0] * np.sqrt(x[0])
    return np.stack([inflow - between, between - raw[1] * np.sqrt(x[1])])


def recorded(count=400, seed=3, share=0.02):
    """Return the levels by Euler's method, with noise, a share of them far off."""
    random = np.random.default_rng(seed)
    inflow = 0.6 + 0.4 * random.random(count // 20 + 1).repeat(20)[:count]
    x = [np.array([0.8, 1.2])]
    for now in inflow[:-1]:
        x.append(x[-1] + STEP * slope(TRUTH, x[-1], now))
    noise = NOISE * random.normal(size=(count, 2))
    noise[random.random((count, 2)) < share] += 20 * NOISE
    measured = np.array(x) + noise
    return Experiment(
        "run", STEP, {"upper": measured[:, 0], "lower": measured[:, 1], "inflow": inflow}
    )


@pytest.fixture(scope="module")
def windows():
    return cut([recorded()], Tanks.states, Tanks.inputs, HORIZON, placement=Jittered(1))


def objective(noise, free=()):
    predictor, loss = Predictor(STEP, RungeKutta(EULER)), Loss(noise=noise)
    loss = replace(loss, free_starts=dict.fromkeys(free))
    return Objective(predictor, Tanks(*TRUTH), np.ones(2), loss)


def residuals(raw, windows):
    """Return the errors, (step, state, window)."""
    x, rows = windows.states.T[:, windows.starts], []
    for k in range(windows.horizon):
        x = x + STEP * slope(raw, x, windows.inputs.T[0, windows.starts + k])
        rows.append(windows.states.T[:, windows.starts + k + 1] - x)
    return np.array(rows)


# --- the likelihood -----------------------------------------------------------------------------


def likelihood(raw, windows):
    """Return SciPy's negative log likelihood of all errors."""
    gap = np.moveaxis(residuals(raw, windows), 1, -1)
    return -students_t.logpdf(gap, NU, scale=SCALES).sum()


def test_loss_and_gradient_are_the_likelihoods(windows):
    raw = np.array([0.7, 0.6])
    one = objective(StudentT(NU, tuple(SCALES)))
    terms = one.gauss_newton(raw, windows)
    loss, gradient = one.loss_and_gradient(raw, windows)
    # A sum of squares is that many log likelihoods.
    unit = terms.count * (NU + 1) / (2 * NU) / np.mean(SCALES**2)
    nothing = np.zeros((HORIZON, len(windows), 2))
    least = -students_t.logpdf(nothing, NU, scale=SCALES).sum()
    assert unit * loss == pytest.approx(likelihood(raw, windows) - least, rel=1e-10)
    assert terms.loss == pytest.approx(loss, rel=1e-12)
    step = 1e-5
    slopes = [
        sum(
            c * likelihood(raw + k * step * e, windows)
            for k, c in ((-2, 1), (-1, -8), (1, 8), (2, -1))
        )
        / (12 * step)
        for e in np.eye(2)
    ]
    np.testing.assert_allclose(unit * gradient, slopes, rtol=1e-8)
    np.testing.assert_allclose(-2 * unit / terms.count * terms.descent, slopes, rtol=1e-8)


def test_with_many_degrees_it_is_the_sum_of_squares(windows):
    raw, many = np.array([0.7, 0.6]), StudentT(1e9, (1.0, 1.0))
    squares, tempered = (objective(n).gauss_newton(raw, windows) for n in (None, many))
    assert tempered.loss == pytest.approx(squares.loss, rel=1e-7)
    np.testing.assert_allclose(tempered.normal, squares.normal, rtol=1e-7)


def test_weights_and_curvature_are_derivatives_of_what_is_summed():
    """By JAX, where errors are large and where they are none."""
    noise, z = StudentT(NU), np.array([-3e4, -30.0, -2.0, 0.0, 1e-9, 1e-3, 0.7, 15.0])
    with float64():
        slopes = jax.vmap(jax.grad(lambda one: noise.squares(one) / 2))(jnp.asarray(z))
        bent = jax.vmap(jax.grad(jax.grad(lambda one: noise.squares(one) / 2)))(jnp.asarray(z))
        w, squares, curvature = np.asarray(noise.moments(jnp.asarray(z)))
        back = noise.unweighted(jnp.sqrt(noise.weight(jnp.asarray(z))) * z)
        far = noise.squares(noise.unweighted(jnp.asarray(1e3)))
    np.testing.assert_allclose(slopes, w * z, rtol=1e-12)
    np.testing.assert_allclose(squares, w * z**2, rtol=1e-12)
    np.testing.assert_allclose(curvature, bent, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(back, z, rtol=1e-7)
    assert np.isfinite(far)


@pytest.mark.parametrize("given", [{"degrees": 0.0}, {"degrees": np.nan}, {"scale": (1.0, 0.0)}])
def test_what_is_no_distribution_is_refused(given):
    with pytest.raises(InputError, match=r"must be > 0"):
        StudentT(**given)


# --- its scale ----------------------------------------------------------------------------------


def test_the_scale_is_the_most_likely_one(windows):
    one = objective(StudentT(NU))
    problem = Problem(one, Reported(one.layout, windows.states[:3]), windows, np.ones(2, bool))
    problem, raw = with_scale(problem, np.array([0.7, 0.6]), cold=True)
    gap = residuals(raw, windows)
    found = problem.objective.noise_scale
    for k in range(2):
        _, _, scale = students_t.fit(gap[:, k].ravel(), f0=NU, floc=0.0)
        assert found[k] == pytest.approx(scale, rel=0.01)
    own = StudentT(NU, (0.1, 0.2))
    given = replace(problem, objective=objective(own))
    assert with_scale(given, raw, cold=False)[0].objective.loss.noise == own


# --- starts -------------------------------------------------------------------------------------


def test_an_outlier_at_a_start_leaves_the_start_where_the_window_says(windows):
    """The corrections of starts are of the size of the outlier where one is, and of noise else."""
    one = objective(StudentT(NU, (NOISE, NOISE)), Tanks.states)
    few = cut([recorded()], Tanks.states, Tanks.inputs, 12, placement=Jittered(1, stride=1))
    clean = recorded(share=0.0).stack(Tanks.states)
    corrections = summed(one.error, TRUTH, few, normal=False)[3]
    wanted = (clean - few.states)[few.starts].T
    far = np.abs(wanted) > 10 * NOISE
    assert far.sum() > 5
    # Both recordings have the same noise but for the outliers.
    assert np.median(np.abs(corrections - wanted)[far]) < NOISE
    total = moments(one.error, TRUTH, few, corrections)
    assert (total[0] < HORIZON * 2 * len(few)).all()


def test_gradient_and_scores_agree_where_starts_are_free(windows):
    one, raw = objective(StudentT(NU, tuple(SCALES)), Tanks.states), np.array([0.78, 0.52])
    terms = one.gauss_newton(raw, windows)
    _, gradient = one.loss_and_gradient(raw, windows)
    np.testing.assert_allclose(gradient, -2 * terms.descent / terms.count, rtol=1e-4)
    by_sample = one.sample_scores(raw, windows)
    np.testing.assert_allclose(by_sample.sum(axis=1), terms.scores.sum(axis=1), rtol=1e-4)


# --- fits ---------------------------------------------------------------------------------------


def test_outliers_cost_little():
    """Beside least squares without outliers."""
    start = Tanks(first=0.6, second=0.7)
    fits = {}
    for name, share, noise in (("clean", 0.0, None), ("outliers", 0.02, StudentT())):
        run = recorded(600, 5, share)
        plan = default_plan(start, [run])
        plan = replace(
            plan,
            stages=plan.stages[3:7],
            solver=RungeKutta(EULER),
            loss=replace(plan.loss, noise=noise),
        )
        fits[name] = identify(start, [run], plan=plan)
    for parameter, true in zip(("first", "second"), TRUTH, strict=True):
        clean, found = (fit.parameters[parameter] for fit in fits.values())
        low, high = found.interval_95
        assert low < true < high
        assert found.std < 1.5 * clean.std
    assert fits["outliers"].horizon.answered
    assert not fits["outliers"].horizon.objections
