"""Smoothing by marginal likelihood: closed forms, recovered variances, shrinkage under noise."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from penode.pmsm.balance.smoothing import Roughness, _Normal, lowest, smoothed, stiffened
from penode.training.weak_form import WeakRegression

COUNT, SIZE = 400, 12


def problem(rng, noise, deviation=1.0, fixed=1):
    """Return equations with `fixed` free coefficients and SIZE that are drawn at random."""
    matrix = rng.normal(size=(COUNT, fixed + SIZE))
    truth = np.concatenate([np.full(fixed, 3.0), deviation * rng.normal(size=SIZE)])
    # Every equation four times, as windows that overlap by three quarters count.
    target = matrix @ truth + noise * rng.normal(size=COUNT)
    every = WeakRegression(np.repeat(matrix, 4, axis=0), np.repeat(target, 4))
    return every, truth, matrix, target


def test_evidence_is_the_likelihood_of_what_is_left_beside_free_coefficients(rng):
    """REML: the density of contrasts that are orthogonal to the free columns."""
    every, _, matrix, target = problem(rng, 0.5)
    penalty = Roughness.of(1, np.eye(SIZE))
    normal = _Normal.of(every, [penalty])
    found, expected = [], []
    for log in (-4.0, -2.5, -1.0):
        strength = normal.balance[0] * 10.0**log / 4  # each equation came four times
        random = matrix[:, 1:] / np.sqrt(strength)
        found.append(normal.evidence(np.array([log]))[0])
        expected.append(-2 * density_of(matrix[:, :1], random, target))
    np.testing.assert_allclose(np.diff(found), np.diff(expected), rtol=1e-6)


def density_of(free, random, target):
    """Return the log density of contrasts, random columns of deviation 1 beside noise of 1."""
    left = np.linalg.qr(free, mode="complete")[0][:, free.shape[1] :]
    covariance = left.T @ (np.eye(len(target)) + random @ random.T) @ left
    rest = left.T @ target
    size = rest @ np.linalg.solve(covariance, rest) / len(rest)
    return multivariate_normal(cov=size * covariance).logpdf(rest)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_evidence_for_a_free_coefficient_does_not_depend_on_the_unit_of_the_target(rng, unit):
    every = problem(rng, 0.5, fixed=2)[0]
    columns = np.delete(every.matrix, 1, axis=1)

    def gain(unit):
        fewer, more = (
            smoothed(
                WeakRegression(matrix, unit * every.target), [Roughness.of(first, np.eye(SIZE))]
            )
            for first, matrix in ((1, columns), (2, every.matrix))
        )
        return fewer.evidence - more.evidence

    assert gain(unit) == pytest.approx(gain(1.0), rel=1e-9)
    assert gain(1.0) > 100.0


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_evidence_compares_models_with_and_without_a_penalised_part(rng, unit):
    """Whatever unit the part is in, and though its penalty has no eigenvalues of one."""
    every, _, matrix, target = problem(rng, 0.5)
    first, second = 1 + SIZE // 2, SIZE - SIZE // 2
    scaled = every.matrix * np.repeat([1.0, unit], [first, second])
    weights = np.linspace(0.5, 2.0, second)
    penalties = [Roughness.of(1, np.eye(first - 1)), Roughness.of(first, np.diag(weights))]
    one = _Normal.of(WeakRegression(scaled[:, :first], every.target), penalties[:1])
    both = _Normal.of(WeakRegression(scaled, every.target), penalties)
    logs = np.array([-2.0, -1.0])
    strength = both.balance * 10.0**logs / 4
    near = matrix[:, 1:first] / np.sqrt(strength[0])
    far = unit * matrix[:, first:] / np.sqrt(strength[1] * weights)
    found = both.evidence(logs)[0] - one.evidence(logs[:1])[0]
    free = matrix[:, :1]
    wanted = density_of(free, np.hstack([near, far]), target) - density_of(free, near, target)
    assert found == pytest.approx(-2 * wanted, rel=1e-6)


def test_the_strength_is_noise_over_spread(rng):
    every, *_ = problem(rng, 0.5, deviation=2.0)
    found = smoothed(every, [Roughness.of(1, np.eye(SIZE))])
    assert found.prior_variance[0] == pytest.approx(4.0, rel=0.8)
    assert found.strength[0] == pytest.approx(4 * 0.25 / found.prior_variance[0], rel=0.15)


def test_noise_shrinks_what_is_penalised_and_nothing_else(rng):
    every, truth, *_ = problem(rng, 30.0, deviation=0.1)
    found = smoothed(every, [Roughness.of(1, np.eye(SIZE))])
    plain = every.solve()
    assert np.linalg.norm(found.solution[1:]) < 0.5 * np.linalg.norm(plain[1:])
    assert found.solution[0] == pytest.approx(plain[0], abs=1.0)
    assert np.linalg.norm(found.solution - truth) < np.linalg.norm(plain - truth)


def test_strengths_are_raised_alike_until_the_solution_is_possible(rng):
    every, *_ = problem(rng, 0.5)
    penalties = [Roughness.of(1, np.eye(SIZE)[:6, :6]), Roughness.of(7, np.eye(SIZE)[:6, :6])]
    found = smoothed(every, penalties)
    least = np.linalg.norm(found.solution[1:]) / 2
    stiff = stiffened(every, penalties, found, lambda one: np.linalg.norm(one[1:]) < least)
    assert np.linalg.norm(stiff.solution[1:]) < least
    raised = stiff.strength / found.strength
    np.testing.assert_allclose(raised, raised[0])
    steps = np.log10(raised[0]) / 0.5
    assert steps == pytest.approx(round(steps))
    before = stiffened(every, penalties, found, lambda one: True)
    np.testing.assert_allclose(before.strength / found.strength, 10**0.5)
    assert stiffened(every, penalties, found, lambda one: False) is None


def test_two_penalties_have_strengths_of_their_own(rng):
    matrix = rng.normal(size=(COUNT, 2 * SIZE))
    truth = np.concatenate([rng.normal(size=SIZE), np.zeros(SIZE)])
    target = np.repeat(matrix @ truth + 0.5 * rng.normal(size=COUNT), 4)
    every = WeakRegression(np.repeat(matrix, 4, axis=0), target)
    blocks = [Roughness.of(k * SIZE, np.eye(SIZE)) for k in range(2)]
    found = smoothed(every, blocks)
    assert found.prior_variance[0] > 100 * found.prior_variance[1]
    assert np.linalg.norm(found.solution[SIZE:]) < 0.3 * np.linalg.norm(every.solve()[SIZE:])


def test_the_search_ends_at_the_lowest_of_a_lattice_and_evaluates_no_place_twice():
    bottom, seen = np.array([7.3, -11.6]), []

    def bowl(place):
        seen.append(tuple(place))
        a, b = place - bottom
        return a**2 + a * b / 2 + 3 * b**2

    np.testing.assert_array_equal(lowest(bowl, np.array([-12, -12]), (-28, 12)), [7, -12])
    assert len(seen) == len(set(seen)) < 60
    np.testing.assert_array_equal(lowest(bowl, np.array([-12, -12]), (-28, 4)), [4, -11])
