"""Laws of the amplitude-invariant Clarke-Park transform."""

import jax.numpy as jnp
import numpy as np
import pytest

from penode.arrays import float64
from penode.pmsm.machine.frames import abc_from_dq, dq_from_abc, quarter_turned, solved

RNG = np.random.default_rng(1)
THETA = RNG.uniform(-10.0, 10.0, 50)
DQ = RNG.normal(size=(50, 2))


def test_dq_survives_the_round_trip():
    np.testing.assert_allclose(dq_from_abc(abc_from_dq(DQ, THETA), THETA), DQ, atol=1e-14)


def test_phases_without_zero_sequence_survive_the_round_trip():
    abc = RNG.normal(size=(50, 3))
    abc -= abc.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(abc_from_dq(dq_from_abc(abc, THETA), THETA), abc, atol=1e-14)


def test_zero_sequence_is_dropped():
    np.testing.assert_allclose(dq_from_abc(np.ones((50, 3)), THETA), 0.0, atol=1e-15)


@pytest.mark.parametrize("lead", [0.0, 0.4, np.pi / 2])
def test_balanced_set_becomes_a_constant_vector_of_its_peak_value(lead):
    phases = np.array([0.0, -2 * np.pi / 3, 2 * np.pi / 3])
    abc = 7.0 * np.cos(THETA[:, None] + lead + phases)
    expected = np.broadcast_to([7.0 * np.cos(lead), 7.0 * np.sin(lead)], (50, 2))
    np.testing.assert_allclose(dq_from_abc(abc, THETA), expected, atol=1e-13)


def test_positive_sequence_turns_forward():
    a, b, c = abc_from_dq(np.array([1.0, 0.0]), np.array(2 * np.pi / 3))
    np.testing.assert_allclose([a, b, c], [-0.5, 1.0, -0.5], atol=1e-15)


def test_turning_the_frame_turns_the_vector_back():
    shift = 0.7
    turned = dq_from_abc(abc_from_dq(DQ, THETA), THETA + shift)
    as_complex = (DQ[:, 0] + 1j * DQ[:, 1]) * np.exp(-1j * shift)
    np.testing.assert_allclose(turned[:, 0] + 1j * turned[:, 1], as_complex, atol=1e-14)


def test_power_of_the_phases_is_three_halves_of_dq():
    current = RNG.normal(size=(50, 2))
    phases = (abc_from_dq(DQ, THETA) * abc_from_dq(current, THETA)).sum(axis=1)
    np.testing.assert_allclose(phases, 1.5 * (DQ * current).sum(axis=1), atol=1e-13)


def test_leading_axes_broadcast():
    assert dq_from_abc(np.zeros((4, 5, 3)), np.zeros((4, 5))).shape == (4, 5, 2)
    assert abc_from_dq(np.zeros(2), np.zeros((4, 5))).shape == (4, 5, 3)


@pytest.mark.parametrize("library", [np, jnp])
def test_a_quarter_turn_and_systems_of_two_equations(rng, library):
    matrix, vector = rng.normal(size=(2, 2, 7)), rng.normal(size=(2, 7))
    with float64():
        turned = quarter_turned(library.asarray(vector))
        solution = solved(library.asarray(matrix), library.asarray(vector))
    assert isinstance(turned, library.ndarray)
    assert isinstance(solution, library.ndarray)
    np.testing.assert_array_equal(turned, np.array([[0, -1], [1, 0]]) @ vector)
    expected = np.linalg.solve(np.moveaxis(matrix, -1, 0), vector.T[..., None])[..., 0].T
    np.testing.assert_allclose(solution, expected, rtol=1e-10)
