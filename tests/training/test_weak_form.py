"""The weak form on systems with a closed form, and the disturbances it must not see."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from penode.training.weak_form import HannWindow, WeakRegression, join

STEP, LENGTH = 1e-2, 200


def weak_regression(stored, supplied, held, time_step, length):
    """Return the equations of one recording; stored and supplied are (time, state, column)."""
    window = HannWindow(time_step, length)
    balance = window.of_supply(supplied) + window.of_store(stored)
    return WeakRegression(balance.reshape(-1, balance.shape[-1]), -window.of_held(held).ravel())


def smooth_system(samples=2001):
    """m x' = -a x + b y + 0.3 with y = cos(3 t): the steady answer in closed form, and m, a, b."""
    m, a, b = 0.4, 1.7, 2.5
    time = STEP * np.arange(samples)
    gain = b / (a + 3j * m)
    x = (gain * np.exp(3j * time)).real + 0.3 / a
    return x, np.cos(3 * time), np.array([m, a, b])


def regression_of(x, y, held, length=LENGTH):
    stored = np.stack([x, 0 * x, 0 * x], axis=1)[:, None]
    supplied = np.stack([0 * x, -x, y], axis=1)[:, None]
    return weak_regression(stored, supplied, held[:, None], STEP, length)


def test_coefficients_of_a_smooth_linear_system():
    x, y, truth = smooth_system()
    found = regression_of(x, y, np.full(len(x), 0.3)).solve()
    # The second derivative of the window jumps at its ends: (1 / LENGTH)^2 of the answer is left.
    np.testing.assert_allclose(found, truth, rtol=1e-5)


def held_system(random, samples=3000):
    """x' = A x + B u with u held over each sample, solved exactly; L = 0.4, R = 1.7."""
    inductance, resistance, speed = 0.4, 1.7, 5.0
    rate = np.array([[-resistance / inductance, speed], [-speed, -resistance / inductance]])
    block = np.zeros((4, 4))
    block[:2, :2], block[:2, 2:] = rate, np.eye(2) / inductance
    transition = expm(block * STEP)
    time = STEP * np.arange(samples)
    u = np.stack([np.sin(2.1 * time), np.cos(1.3 * time)], axis=1) + random.normal(
        size=(samples, 2)
    )
    x = np.zeros((samples, 2))
    for k in range(samples - 1):
        x[k + 1] = transition[:2, :2] @ x[k] + transition[:2, 2:] @ u[k]
    return x, u, speed, np.array([inductance, resistance])


def test_coefficients_of_a_system_with_held_inputs(rng):
    x, u, speed, truth = held_system(rng)
    rotated = np.stack([-x[:, 1], x[:, 0]], axis=1)
    stored = np.stack([x, 0 * x], axis=2)
    supplied = np.stack([-speed * rotated, -x], axis=2)
    found = weak_regression(stored, supplied, u, STEP, LENGTH).solve()
    # The current has a kink at every sample, which the trapezoidal rule sees to second order.
    np.testing.assert_allclose(found, truth, rtol=2e-3)


def test_held_input_is_integrated_exactly():
    """A pulse one sample wide: the area of the Hann window between two samples."""
    nothing = np.zeros((13, 1, 1))
    for k in range(12):
        pulse = np.zeros((13, 1))
        pulse[k] = 1.0
        area, _ = quad(lambda t: np.sin(np.pi * t / 12) ** 2, k, k + 1)
        target = weak_regression(nothing, nothing, pulse, STEP, 12).target
        np.testing.assert_allclose(target, [-area * STEP], rtol=1e-12)


def test_one_row_a_window_and_state():
    """50 states of width 2, windows of 8 intervals: starts at 0, 2, .., 40."""
    values = np.zeros((50, 2, 3))
    regression = weak_regression(values, values, np.zeros((50, 2)), STEP, 8)
    assert regression.matrix.shape == (2 * 21, 3)
    assert regression.target.shape == (2 * 21,)


def test_longest_window_is_the_recording():
    values = np.zeros((50, 1, 1))
    held = np.zeros((50, 1))
    assert len(weak_regression(values, values, held, STEP, 49).target) == 1
    with pytest.raises(ValueError, match="window shape"):
        weak_regression(values, values, held, STEP, 50)


# --- disturbances -----------------------------------------------------------------------------


@pytest.mark.parametrize("harmonic", [1, 2, 3, 7])
def test_two_periods_null_a_disturbance_and_its_harmonics(harmonic):
    """A periodic disturbance of state, supply and input leaves every equation as it was."""
    x, y, _ = smooth_system()
    held = np.full(len(x), 0.3)
    ripple = 0.5 * np.cos(2 * np.pi * 2 * harmonic * np.arange(len(x)) / LENGTH + 0.4)
    clean = regression_of(x, y, held)
    disturbed = regression_of(x + ripple, y - 2 * ripple, held + ripple)
    size = np.abs(clean.matrix).max()
    np.testing.assert_allclose(disturbed.matrix, clean.matrix, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(disturbed.target, clean.target, rtol=0, atol=1e-13 * size)


@pytest.mark.parametrize("periods", [1.0, 1.5])
def test_other_windows_do_not(periods):
    x, y, _ = smooth_system()
    held = np.full(len(x), 0.3)
    ripple = 0.5 * np.cos(2 * np.pi * periods * np.arange(len(x)) / LENGTH)
    clean, disturbed = regression_of(x, y, held), regression_of(x + ripple, y, held + ripple)
    assert np.abs(disturbed.matrix - clean.matrix).max() > 1e-3
    assert np.abs(disturbed.target - clean.target).max() > 1e-3


# --- least squares ----------------------------------------------------------------------------


def test_independence_is_one_minus_r_squared(rng):
    columns = np.linalg.qr(rng.normal(size=(40, 4)))[0] * [1e-6, 1.0, 1e4, 1.0]
    orthogonal = WeakRegression(columns, np.zeros(40))
    for k in range(4):
        assert orthogonal.independence(k) == pytest.approx(1.0, abs=1e-12)
    duplicated = WeakRegression(np.column_stack([columns, 3 * columns[:, 0]]), np.zeros(40))
    assert duplicated.independence(0) == pytest.approx(0.0, abs=1e-12)
    assert duplicated.independence(1) == pytest.approx(1.0, abs=1e-12)
    mixed = columns[:, 1] + 2 * columns[:, 3]
    half = WeakRegression(np.column_stack([mixed, columns[:, 3]]), np.zeros(40))
    assert half.independence(0) == pytest.approx(1 / 5, abs=1e-12)


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
def test_a_column_of_zeros_has_nothing_of_its_own():
    regression = WeakRegression(np.column_stack([np.zeros(4), np.arange(4.0)]), np.ones(4))
    assert regression.independence(0) == 0.0


def test_a_single_column_is_independent():
    assert WeakRegression(np.arange(4.0)[:, None], np.ones(4)).independence(0) == 1.0


def test_solve_does_not_mind_units(rng):
    matrix, truth = rng.normal(size=(30, 3)), np.array([1.0, -2.0, 0.5])
    units = np.array([1e-9, 1.0, 1e9])
    found = WeakRegression(matrix * units, matrix @ truth).solve()
    np.testing.assert_allclose(found * units, truth, rtol=1e-12)


def test_a_column_of_zeros_gets_no_coefficient(rng):
    matrix = np.column_stack([rng.normal(size=30), np.zeros(30)])
    found = WeakRegression(matrix, 4 * matrix[:, 0]).solve()
    np.testing.assert_allclose(found, [4.0, 0.0], atol=1e-12)


def test_join_stacks_the_equations(rng):
    parts = [WeakRegression(rng.normal(size=(n, 2)), rng.normal(size=n)) for n in (3, 5)]
    joined = join(parts)
    np.testing.assert_array_equal(joined.matrix, np.vstack([p.matrix for p in parts]))
    np.testing.assert_array_equal(joined.target, np.concatenate([p.target for p in parts]))


@pytest.mark.parametrize("length", [3, 8, 21])
def test_a_transformed_quantity_is_integrated_as_supply_and_store(length):
    random = np.random.default_rng(3)
    stored, matrices = random.normal(size=(50, 2, 5)), random.normal(size=(50, 2, 2))
    window = HannWindow(STEP, length)
    apart = window.of_supply(matrices @ stored) + window.of_store(stored)
    together = window.of_transformed(stored, matrices)
    np.testing.assert_allclose(together, apart, rtol=0, atol=1e-12 * np.abs(apart).max())
