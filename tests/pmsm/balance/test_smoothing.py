"""Smoothing by marginal likelihood: closed forms, recovered variances, shrinkage under noise."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from penode.pmsm.balance.smoothing import Roughness, _Normal, smoothed
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
    left = np.linalg.qr(matrix[:, :1], mode="complete")[0][:, 1:]
    found, expected = [], []
    for log in (-4.0, -2.5, -1.0):
        strength = normal.balance[0] * 10.0**log / 4  # each equation came four times
        covariance = left.T @ (np.eye(COUNT) + matrix[:, 1:] @ matrix[:, 1:].T / strength) @ left
        rest = left.T @ target
        size = rest @ np.linalg.solve(covariance, rest) / len(rest)
        density = multivariate_normal(cov=size * covariance).logpdf(rest)
        found.append(normal.evidence(np.array([log]))[0])
        expected.append(-2 * density)
    np.testing.assert_allclose(np.diff(found), np.diff(expected), rtol=1e-6)


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


def test_two_penalties_have_strengths_of_their_own(rng):
    matrix = rng.normal(size=(COUNT, 2 * SIZE))
    truth = np.concatenate([rng.normal(size=SIZE), np.zeros(SIZE)])
    target = np.repeat(matrix @ truth + 0.5 * rng.normal(size=COUNT), 4)
    every = WeakRegression(np.repeat(matrix, 4, axis=0), target)
    blocks = [Roughness.of(k * SIZE, np.eye(SIZE)) for k in range(2)]
    found = smoothed(every, blocks)
    assert found.prior_variance[0] > 100 * found.prior_variance[1]
    assert np.linalg.norm(found.solution[SIZE:]) < 0.3 * np.linalg.norm(every.solve()[SIZE:])
