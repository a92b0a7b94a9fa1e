"""Each penalty against its formula in NumPy, in the objective, and in a fit."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode import Contiguous, Experiment, Model, Predictor, parameter, physical
from penode.arrays import Leaf, float64
from penode.data.windows import cut
from penode.models.layout import Layout
from penode.models.parameters import Normal
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.loss import Loss
from penode.training.penalties import (
    GaussianPrior,
    Orthogonality,
    Priors,
    Smoothness,
    SoftReciprocity,
    WeightDecay,
)
from penode.training.residuals import Objective

STEP = 0.1


class Plane(Model):
    """x' = u - c x - learned(x), learned(x) = W x + V tanh(x)."""

    states: ClassVar[tuple[str, ...]] = ("a", "b")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m")

    W: Leaf = parameter()
    V: Leaf = parameter(prior=Normal(0.1, 2.0))
    c: Leaf = physical("1/s", prior=Normal(0.7, 0.25))

    def derivative(self, x, u):
        return u[0] - self.c * x - self.learned(x)

    def learned(self, x):
        product = "ij...,j...->i..."
        return jnp.einsum(product, self.W, x) + jnp.einsum(product, self.V, jnp.tanh(x))


W, V = np.array([[0.5, -0.3], [0.8, 1.1]]), np.array([[0.2, 0.9], [-0.4, 0.6]])
PLANE = Plane(W, V, 0.4)
FACTOR = np.random.default_rng(4).normal(size=(3, 8)) / 5
BELIEF = GaussianPrior(FACTOR, np.array([0.2, 0.3, 0.4]), mean=np.array([0.1, 0.0, -0.2]))
POINTS = np.random.default_rng(2).uniform(-1.5, 1.5, (12, 2))


def learned(x):
    return W @ x + V @ np.tanh(x)


def regressors(x):
    """Return those of c, and of another parameter that acts on the second output alone."""
    return jnp.stack([x, jnp.stack([0 * x[0], 1 + x[0] ** 2])])


def residuals_of(penalty, model=PLANE):
    layout = Layout(model)
    residuals = jax.jit(lambda raw: penalty.residuals(layout, layout.values(raw)))
    with float64():
        return np.asarray(residuals(layout.raw(model)))


def assert_residuals(penalty, expected):
    """Compare them in any order and of any sign: only their squares count."""
    found, wanted = np.sort(np.abs(residuals_of(penalty))), np.sort(np.abs(np.ravel(expected)))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-14)


# --- formulas ---------------------------------------------------------------------------------


def test_weight_decay_is_the_mean_square_of_its_group():
    weights = np.concatenate([W.ravel(), V.ravel()])
    assert_residuals(WeightDecay(0.3), weights * np.sqrt(0.3 / 8))
    assert_residuals(WeightDecay(0.3, "physical"), [0.4 * np.sqrt(0.3)])


def test_priors_are_standardised_distances():
    distances = np.append((V.ravel() - 0.1) / 2.0, (0.4 - 0.7) / 0.25)
    assert_residuals(Priors(noise=0.2, count=50), distances * 0.2 / np.sqrt(50))


def test_a_gaussian_prior_is_the_distance_of_its_combinations():
    weights = np.concatenate([W.ravel(), V.ravel()])
    assert_residuals(BELIEF, FACTOR @ weights - [0.1, 0.0, -0.2])
    np.testing.assert_array_equal(BELIEF.slopes(Layout(PLANE))[:, :8], FACTOR)
    assert not BELIEF.slopes(Layout(PLANE))[:, 8:].any()  # c is no learned parameter


def test_smoothness_is_the_mean_squared_second_difference():
    x, step = POINTS.T, np.array([0.1, 0.3])
    shifts = [np.array([[0.1], [0.0]]), np.array([[0.0], [0.3]])]
    bends = np.array([learned(x + s) - 2 * learned(x) + learned(x - s) for s in shifts])
    assert_residuals(Smoothness(POINTS, step, 0.6), bends * np.sqrt(0.6 / bends.size))
    only = Smoothness(POINTS, np.array([0.0, 0.3]), 0.6)
    assert_residuals(only, bends[1] * np.sqrt(0.6 / bends[1].size))


def test_soft_reciprocity_is_the_mean_squared_skew_part():
    jacobian = W[..., None] + V[..., None] / np.cosh(POINTS.T) ** 2
    skew = (jacobian[0, 1] - jacobian[1, 0]) / 2
    assert_residuals(SoftReciprocity(POINTS, 0.6), skew * np.sqrt(0.6 / len(POINTS)))


def test_orthogonality_is_the_share_that_the_regressors_explain():
    matrix = np.asarray(regressors(POINTS.T)).reshape(2, -1).T
    output = learned(POINTS.T).ravel()
    explained = matrix @ np.linalg.lstsq(matrix, output)[0]
    found = residuals_of(Orthogonality(POINTS, regressors, 0.6))
    assert found.shape == (2,)
    assert found @ found == pytest.approx(0.6 * np.mean(explained**2), rel=1e-6)


def test_a_straight_map_is_smooth():
    straight = Plane(W, 0 * V, 0.4)
    found = residuals_of(Smoothness(POINTS, np.array([0.1, 0.3]), 1.0), straight)
    np.testing.assert_allclose(found, 0, atol=1e-15)


def test_a_gradient_is_reciprocal():
    gradient = Plane(W + W.T, np.diag([0.3, -0.8]), 0.4)
    np.testing.assert_allclose(residuals_of(SoftReciprocity(POINTS, 1.0), gradient), 0, atol=1e-15)


# --- in the objective -------------------------------------------------------------------------

ALL = (
    WeightDecay(0.3),
    Priors(0.2, 50),
    BELIEF,
    Smoothness(POINTS, np.array([0.1, 0.3]), 40.0),
    SoftReciprocity(POINTS, 0.6),
    Orthogonality(POINTS, regressors, 0.6),
)


def objective_of(model, penalties=()):
    predictor = Predictor(STEP, RungeKutta(EULER))
    return Objective(predictor, model, np.ones(len(model.states)), Loss(penalties=tuple(penalties)))


def windows_of(model, horizon=4, **channels):
    run = Experiment("run.csv", STEP, channels)
    return cut([run], model.states, model.inputs, horizon, placement=Contiguous())


def test_a_gaussian_prior_varies_the_scores_as_it_says(rng):
    """A residual rho of variance v adds n rho drho to the scores of n residuals."""
    a, b, u = rng.normal(size=(3, 90))
    windows, raw = windows_of(PLANE, a=a, b=b, u=u), Layout(PLANE).raw(PLANE)
    terms = objective_of(PLANE, [BELIEF, WeightDecay(0.3)]).gauss_newton(raw, windows)
    slopes = BELIEF.slopes(Layout(PLANE))
    expected = terms.count**2 * slopes.T @ np.diag(BELIEF.variance) @ slopes
    np.testing.assert_allclose(terms.prior, expected, rtol=1e-12)
    assert objective_of(PLANE, [WeightDecay(0.3)]).gauss_newton(raw, windows).prior == 0.0


def test_gradient_and_gauss_newton_terms_have_the_penalties(rng):
    a, b, u = rng.normal(size=(3, 90))
    windows, raw = windows_of(PLANE, a=a, b=b, u=u), Layout(PLANE).raw(PLANE)
    bare = objective_of(PLANE).gauss_newton(raw, windows)
    objective = objective_of(PLANE, ALL)
    terms = objective.gauss_newton(raw, windows)

    def stacked(raw):
        values = objective.layout.values(raw)
        return jnp.concatenate([p.residuals(objective.layout, values) for p in ALL])

    with float64():
        both = jax.jit(lambda raw: (stacked(raw), jax.jacfwd(stacked)(raw)))
        penalty, slope = map(np.asarray, both(raw))
    assert terms.count == bare.count
    assert terms.loss - bare.loss == pytest.approx(penalty @ penalty, rel=1e-10)
    np.testing.assert_allclose(terms.normal - bare.normal, terms.count * slope.T @ slope, atol=1e-9)
    gap = terms.descent - bare.descent
    np.testing.assert_allclose(gap, -terms.count * slope.T @ penalty, atol=1e-9)
    np.testing.assert_array_equal(terms.scores, bare.scores)
    loss, gradient = objective.loss_and_gradient(raw, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-12)
    np.testing.assert_allclose(gradient, -2 * terms.descent / terms.count, rtol=1e-9, atol=1e-12)


# --- in a fit ---------------------------------------------------------------------------------


class Rates(Model):
    """x' = b u + d w + e: linear in what is trained."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u", "w")
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    b: Leaf = physical("1", prior=Normal(1.0, 0.4))
    d: Leaf = physical("1", prior=Normal(-0.3, 0.7))
    e: Leaf = physical("m/s", prior=Normal(0.0, 0.2))

    def derivative(self, x, u):
        return (self.b * u[0] + self.d * u[1] + self.e)[None]


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_priors_give_the_posterior_mean(noise, rng):
    """White noise on each one-step prediction; w never moves, so only the prior knows d."""
    u, count = rng.normal(size=80), 79
    regressor = STEP * np.stack([u, 0 * u, np.ones(80)], axis=1)[:-1]
    target = regressor @ [1.8, 9.0, 0.3] + noise * rng.normal(size=count)
    x = np.concatenate([[0.0], np.cumsum(target)])
    objective = objective_of(Rates(0.0, 0.0, 0.0), [Priors(noise, count)])
    windows = windows_of(Rates, horizon=1, x=x, u=u, w=np.zeros(80))
    terms = objective.gauss_newton(np.zeros(3), windows)
    found = np.linalg.solve(terms.normal, terms.descent)
    precision = np.array([0.4, 0.7, 0.2]) ** -2.0
    information = regressor.T @ regressor / noise**2 + np.diag(precision)
    pull = regressor.T @ target / noise**2 + precision * [1.0, -0.3, 0.0]
    np.testing.assert_allclose(found, np.linalg.solve(information, pull), rtol=1e-8)
    assert found[1] == pytest.approx(-0.3, rel=1e-8)
    assert abs(found[0] - 1.0) > 0.1  # the data had a say


class Rolling(Model):
    """v' = u - c v - friction(v): c hides in the slope of the learned friction."""

    states: ClassVar[tuple[str, ...]] = ("v",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m/s",)

    friction: Leaf = parameter()
    c: Leaf = physical("1/s")

    def derivative(self, x, u):
        return u.values - self.c * x - self.learned(x)

    def learned(self, x):
        return (self.friction[0] + self.friction[1] * x[0] + self.friction[2] * x[0] ** 3)[None]


def test_orthogonality_leaves_the_physical_term_its_work(rng):
    """One of c and the friction's slope is free; the friction found is orthogonal to v."""
    v, u = [0.0], 2.0 * rng.normal(size=120)
    for push in u[:-1]:
        v.append(v[-1] + STEP * (push - 0.9 * v[-1] - 0.2 - 0.3 * v[-1] ** 3))
    v = np.array(v)
    windows, points = windows_of(Rolling, horizon=1, v=v, u=u), v[:, None]
    bare = objective_of(Rolling(np.zeros(3), 0.0)).gauss_newton(np.zeros(4), windows)
    assert np.linalg.cond(bare.normal) > 1e12
    kept = Orthogonality(points, lambda x: x[None], 1.0)
    terms = objective_of(Rolling(np.zeros(3), 0.0), [kept]).gauss_newton(np.zeros(4), windows)
    *friction, c = np.linalg.solve(terms.normal, terms.descent)
    output = np.polynomial.polynomial.polyval(v, [friction[0], friction[1], 0, friction[2]])
    assert abs(output @ v) < 1e-8 * np.linalg.norm(output) * np.linalg.norm(v)
    whole = 0.9 * v + 0.2 + 0.3 * v**3
    np.testing.assert_allclose(c * v + output, whole, atol=1e-8)
    assert c == pytest.approx(whole @ v / (v @ v), rel=1e-8)
