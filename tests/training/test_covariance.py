"""HAC sums against the double sum they stand for, and deviations against known cases."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from penode.arrays import float64
from penode.data.windows import Windows
from penode.models.layout import Layout
from penode.training.covariance import (
    Reported,
    ScoreSeries,
    bartlett,
    dominated_by_few_windows,
    influence,
    prior_covariance,
    reported_covariance,
    sandwich_deviation,
    undetermined,
)
from penode.training.gauss_newton_terms import (
    GaussNewtonTerms,
    inverse_normal,
    marquardt_scale,
)
from penode.validation.autocovariance import bandwidth_of


def windows_of(samples, horizon=1, spacing=1):
    starts = np.arange(0, samples - horizon, spacing)
    return Windows(
        np.zeros((samples, 1)), np.zeros((samples, 0)), starts, 0 * starts, horizon, 1, 1.0
    )


# --- bartlett ---------------------------------------------------------------------------------


def double_sum(series, bandwidth):
    size, length = series.shape
    total = np.zeros((size, size))
    for t in range(length):
        for s in range(length):
            if abs(t - s) < bandwidth:
                weight = 1 - abs(t - s) / bandwidth
                total += weight * np.outer(series[:, t], series[:, s])
    return total


@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(1, 3),
    length=st.integers(1, 25),
    bandwidth=st.integers(1, 40),
)
def test_bartlett_is_the_double_sum(seed, size, length, bandwidth):
    series = np.random.default_rng(seed).normal(size=(size, length))
    expected = double_sum(series, bandwidth)
    np.testing.assert_allclose(bartlett(series, bandwidth), expected, rtol=0, atol=1e-12 * length)


@given(seed=st.integers(0, 2**32 - 1), bandwidth=st.integers(1, 60), offset=st.floats(-1e3, 1e3))
def test_bartlett_is_positive_semidefinite(seed, bandwidth, offset):
    series = np.random.default_rng(seed).normal(size=(4, 30)) + offset
    found = bartlett(series, bandwidth)
    np.testing.assert_array_equal(found, found.T)
    eigenvalues = np.linalg.eigvalsh(found)
    assert eigenvalues[0] >= -1e-13 * eigenvalues[-1]


def test_bandwidth_one_is_the_sum_of_squares(rng):
    series = rng.normal(size=(3, 50))
    np.testing.assert_allclose(bartlett(series, 1), series @ series.T, rtol=1e-12)


@pytest.mark.parametrize(
    ("samples", "horizon", "length"), [(1000, 1, 63), (1000, 40, 80), (40, 1, 9), (5, 3, 6)]
)
def test_correlation_length_is_samples_to_the_0_6_or_two_horizons(samples, horizon, length):
    assert ScoreSeries.of_windows(windows_of(samples, horizon)).bandwidth == length


def test_bandwidth_is_counted_in_windows():
    """1000 samples, one window every 20: 63 samples are 3.15 windows."""
    assert ScoreSeries.of_windows(windows_of(1000, horizon=20, spacing=20)).lags == 3
    assert ScoreSeries.of_windows(windows_of(1000, horizon=1, spacing=500)).lags == 1


def test_a_series_by_sample_is_correlated_over_few_samples_or_as_long_as_it_shows():
    """Andrews for a first-order series of 0.95: 1.1447 (4 rho^2 / (1 - rho^2)^2 N)^(1/3)."""
    white = np.random.default_rng(0).normal(size=(2, 10_000))
    found = ScoreSeries.of_samples(white)
    assert (found.bandwidth, found.lags, found.long_enough) == (22, 22, True)
    slow = lfilter([1.0], [1.0, -0.95], np.random.default_rng(0).normal(size=(1, 10_000)))
    known = 1.1447 * (4 * 0.95**2 / (1 - 0.95**2) ** 2 * 10_000) ** (1 / 3)
    both = ScoreSeries.of_samples(np.concatenate([white, slow]))
    assert both.bandwidth == pytest.approx(known, rel=0.1)
    assert known > 150
    assert not ScoreSeries.of_samples(slow[:, :200]).long_enough


# --- the normal matrix ------------------------------------------------------------------------


def test_inverse_of_a_badly_scaled_normal_matrix(rng):
    root = rng.normal(size=(9, 4))
    units = np.array([1e-5, 1.0, 1e3, 1e-2])
    normal = (root * units).T @ (root * units)
    expected = np.linalg.inv(root.T @ root) / np.outer(units, units)
    found = inverse_normal(normal)
    np.testing.assert_allclose(found * np.outer(units, units), np.linalg.inv(root.T @ root))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_flat_directions_get_no_variance():
    """The data see only the sum of two parameters."""
    normal = np.array([[2.0, 2.0], [2.0, 2.0]])
    inverse = inverse_normal(normal)
    sums, difference = np.array([1.0, 1.0]), np.array([1.0, -1.0])
    assert sums @ inverse @ sums == pytest.approx(0.5)
    assert difference @ inverse @ difference == pytest.approx(0.0, abs=1e-15)
    with_dead = np.diag([4.0, 0.0])
    np.testing.assert_allclose(inverse_normal(with_dead), np.diag([0.25, 0.0]), atol=1e-15)


def test_marquardt_scale_is_the_root_of_the_diagonal_and_never_zero():
    found = marquardt_scale(np.diag([4.0, 1e-6, 0.0]))
    np.testing.assert_allclose(found[:2], [2.0, 1e-3], rtol=1e-14)
    assert found[2] > 0
    assert (marquardt_scale(np.zeros((2, 2))) > 0).all()


# --- deviations of a linear regression --------------------------------------------------------

SAMPLES, REPETITIONS = 3000, 300
TRUTH = np.array([0.7, -0.2])


def autoregressive(random, coefficient, repetitions):
    """Return stationary unit-variance AR(1) series, (repetitions, time)."""
    noise = random.normal(size=(repetitions, SAMPLES + 300))
    series = lfilter([1.0], [1.0, -coefficient], noise, axis=1)[:, 300:]
    return series * np.sqrt(1 - coefficient**2)


def regressions(correlation):
    """Fit y = a + b x + e many times, x AR(0.8) and e AR(correlation).

    Returns the estimates, the deviations that `sandwich_deviation` gives (both (repetition, 2)),
    and the classical deviations.
    """
    random = np.random.default_rng(11)
    x = autoregressive(random, 0.8, 1)[0]
    matrix = np.stack([np.ones(SAMPLES), x], axis=1)
    normal, series = matrix.T @ matrix, ScoreSeries.of_windows(windows_of(SAMPLES + 1))
    estimates, deviations = [], []
    for error in autoregressive(random, correlation, REPETITIONS):
        target = matrix @ TRUTH + error
        estimate = np.linalg.solve(normal, matrix.T @ target)
        residual = target - matrix @ estimate
        scores = matrix.T * residual
        terms = GaussNewtonTerms(np.mean(residual**2), SAMPLES, normal, scores.sum(axis=1), scores)
        estimates.append(estimate)
        deviations.append(sandwich_deviation(terms, np.eye(2), series))
    return np.array(estimates), np.array(deviations), np.sqrt(np.diag(np.linalg.inv(normal)))


def test_white_errors_give_the_classical_standard_errors():
    estimates, deviations, classical = regressions(0.0)
    # Newey-West loses about bandwidth / samples = 4 % of the variance to the fitted residuals.
    np.testing.assert_allclose(deviations.mean(axis=0), classical, rtol=0.04)
    # 300 repetitions know a standard deviation to 4 %.
    np.testing.assert_allclose(estimates.std(axis=0), classical, rtol=0.12)


def test_autoregressive_errors_give_the_known_larger_ones():
    """Var(b) grows by (1 + rho phi) / (1 - rho phi), with phi = 1 for the constant."""
    rho = 0.7
    estimates, deviations, classical = regressions(rho)
    product = rho * np.array([1.0, 0.8])
    known = classical * np.sqrt((1 + product) / (1 - product))
    assert (known / classical > 1.8).all()
    np.testing.assert_allclose(deviations.mean(axis=0), known, rtol=0.08)
    np.testing.assert_allclose(estimates.std(axis=0), known, rtol=0.12)


def test_deviation_is_the_matrix_formula(rng):
    """J A^-1 B A^-1 J' written out, for a reported quantity that mixes parameters."""
    scores, root, jacobian = (rng.normal(size=s) for s in ((3, 200), (40, 3), (2, 3)))
    normal, series = root.T @ root, ScoreSeries.of_windows(windows_of(201))
    terms = GaussNewtonTerms(1.0, 200, normal, scores.sum(axis=1), scores)
    meat = double_sum(scores, series.lags)
    inverse = np.linalg.inv(normal)
    variance = np.diag(jacobian @ inverse @ meat @ inverse @ jacobian.T)
    found = sandwich_deviation(terms, jacobian, series)
    np.testing.assert_allclose(found, np.sqrt(variance), rtol=1e-10)


def test_a_parameter_that_ran_away_spoils_no_other(rng):
    """Its slope is huge or has no number; nothing overflows, and the others stay known."""
    scores, root = (rng.normal(size=size) for size in ((2, 200), (40, 2)))
    jacobian = np.eye(2) * [[1e290], [1.0]]
    terms = GaussNewtonTerms(1.0, 200, root.T @ root, scores.sum(axis=1), scores)
    flat = replace(terms, normal=np.diag([1e-300, 1.0]))
    with np.errstate(all="raise"):
        assert not dominated_by_few_windows(terms, jacobian).any()
        assert undetermined(flat, jacobian).tolist() == [[True, False], [False, False]]
    jacobian[0, 0] = np.inf
    with np.errstate(invalid="ignore"):
        assert dominated_by_few_windows(terms, jacobian)[0]


def test_a_prior_varies_what_the_data_do_not_determine(rng):
    """y = x'theta + e sees one of two directions; the other keeps the prior's own deviation."""
    count, noise, spread = 4000, 0.3, 2.0
    seen = np.array([1.0, 1.0]) / np.sqrt(2)
    matrix = rng.normal(size=(count, 1)) * seen
    penalty = (noise / spread) ** 2 * np.eye(2)  # in units of the summed squares
    normal = matrix.T @ matrix + penalty
    scores = matrix.T * rng.normal(size=count) * noise
    prior = penalty * spread**2 @ penalty
    arguments = (noise**2, count, normal, scores.sum(axis=1), scores)
    series = ScoreSeries.of_windows(windows_of(count + 1))
    terms = GaussNewtonTerms(*arguments, prior)
    across = np.array([[1.0, -1.0]]) / np.sqrt(2)
    both = np.concatenate([seen[None], across])
    found = sandwich_deviation(terms, both, series)
    known = noise / np.linalg.norm(matrix @ seen)
    np.testing.assert_allclose(found, [known, spread], rtol=0.15)
    np.testing.assert_allclose(np.diag(prior_covariance(terms, across)), spread**2, rtol=1e-6)
    assert prior_covariance(terms, seen[None])[0, 0] < (0.01 * known) ** 2
    np.testing.assert_array_equal(prior_covariance(GaussNewtonTerms(*arguments), both), 0.0)
    assert sandwich_deviation(GaussNewtonTerms(*arguments), across, series) < 1e-6


def test_influences_add_up_to_the_remaining_step(rng):
    scores, root, jacobian = (rng.normal(size=s) for s in ((3, 200), (40, 3), (2, 3)))
    terms = GaussNewtonTerms(1.0, 200, root.T @ root, scores.sum(axis=1), scores)
    share = influence(terms, jacobian)
    assert share.shape == (2, 200)
    step = np.linalg.solve(terms.normal, terms.descent)
    np.testing.assert_allclose(share.sum(axis=1), jacobian @ step, rtol=1e-9)


# --- reported quantities ----------------------------------------------------------------------


def test_reported_are_physical_parameters_then_the_map(systems):
    system = systems["duffing"]
    points = np.array([[0.3, 9.0], [-1.0, 9.0], [2.0, 9.0]])
    reported = Reported(Layout(system.model), points)
    values = reported.values(system.raw)
    np.testing.assert_allclose(values[:2], [0.7, 0.3], rtol=1e-14)
    still = np.stack([points[:, 0], 0 * points[:, 0]])
    # At rest and without force the acceleration is -spring / mass.
    spring = -0.7 * system.twin(system.raw[:, None], still, np.zeros((1, 3)))[1]
    np.testing.assert_allclose(values[2:], spring, rtol=1e-12)


def test_reported_jacobian_against_differences(systems):
    system, step = systems["coenergy machine"], 1e-6
    points = np.array([[30.0, -40.0], [0.0, 70.0]])
    reported = Reported(Layout(system.model), points)
    shifts = step * np.eye(len(system.raw))
    slopes = [
        (reported.values(system.raw + s) - reported.values(system.raw - s)) / (2 * step)
        for s in shifts
    ]
    jacobian = reported.jacobian(system.raw)
    assert jacobian.shape == (1 + 4, len(system.raw))
    np.testing.assert_allclose(jacobian, np.stack(slopes, axis=1), rtol=0, atol=1e-8)
    np.testing.assert_array_equal(jacobian[0], [0.0] * 17 + [1.0])


def test_reported_without_a_map_are_the_physical_parameters(systems):
    system = systems["linear machine"]
    layout = Layout(system.model)
    reported = Reported(layout, np.zeros((5, 2)))
    with float64():
        expected = np.asarray(layout.values(jnp.asarray(system.raw)))
    np.testing.assert_allclose(reported.values(system.raw), expected, rtol=1e-15)


def test_what_is_reported_is_differentiated_at_few_more_points_than_there_are():
    """Each point costs a pass of all sensitivities; padding once took a quarter of a fit."""
    assert Reported(None, np.zeros((100, 2)))._padded.shape[1] <= 128


@pytest.mark.parametrize(("memory", "least"), [(0.0, 0.93), (0.8, 0.93), (0.95, 0.9)])
def test_reported_deviations_of_a_mean_cover_where_the_kernel_alone_does_not(memory, least):
    """Of a series of the first order, ten to a hundred bandwidths long; the truth is zero."""
    random, samples, draws = np.random.default_rng(5), 1000, 600
    covered = np.zeros((draws, 2), dtype=bool)
    for draw in range(draws):
        noise = random.normal(size=samples + 500)
        values = lfilter([1.0], [1.0, -memory], noise)[500:]
        series = (values - values.mean())[None] / samples
        both = (f(series, bandwidth_of(series))[0, 0] for f in (reported_covariance, bartlett))
        covered[draw] = [abs(values.mean()) < 1.96 * np.sqrt(variance) for variance in both]
    reported, kernel = covered.mean(axis=0)
    assert least <= reported <= 0.98
    assert kernel < reported
