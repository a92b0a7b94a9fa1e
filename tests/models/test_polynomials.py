"""Polynomials against monomials written out in NumPy."""

from math import comb

import jax
import numpy as np
import pytest

from penode import InputError
from penode.arrays import float64
from penode.models.parameters import with_batch_axis
from penode.models.polynomials import Polynomial, exponents


@jax.jit
def compiled(polynomial, x):
    return polynomial.value_and_jacobian(x)


def evaluate(polynomial, x):
    with float64():
        value, jacobian = compiled(with_batch_axis(polynomial), x)
    return np.asarray(value), np.asarray(jacobian)


def test_exponents_rise_in_degree():
    assert exponents(1, 3) == ((0,), (1,), (2,), (3,))
    assert exponents(2, 2) == ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    assert exponents(3, 0) == ((0, 0, 0),)


@pytest.mark.parametrize(("inputs", "degree"), [(1, 7), (2, 5), (3, 4), (4, 2)])
def test_exponents_are_all_of_them_once(inputs, degree):
    found = exponents(inputs, degree)
    assert len(set(found)) == len(found) == comb(inputs + degree, degree)
    assert all(min(term) >= 0 and sum(term) <= degree for term in found)
    assert sorted(found, key=sum) == list(found)


@pytest.mark.parametrize(("inputs", "degree"), [(1, 0), (1, 7), (2, 5), (3, 3)])
def test_value_and_jacobian_are_sums_of_monomials(inputs, degree, rng):
    x = rng.uniform(-1.5, 1.5, (inputs, 50))
    x[:, :3] = [[0.0, -1.0, 1.0]]
    powers = np.array(exponents(inputs, degree))
    coefficients = rng.normal(size=(2, len(powers)))
    value, jacobian = evaluate(Polynomial(inputs, degree, coefficients), x)
    monomials = np.prod(x[None] ** powers[:, :, None], axis=1)
    np.testing.assert_allclose(value, coefficients @ monomials, rtol=0, atol=1e-12)
    for i in range(inputs):
        lowered = powers.copy()
        lowered[:, i] = np.maximum(lowered[:, i] - 1, 0)
        slopes = powers[:, i, None] * np.prod(x[None] ** lowered[:, :, None], axis=1)
        np.testing.assert_allclose(jacobian[:, i], coefficients @ slopes, rtol=0, atol=1e-12)


def test_an_energy_by_hand():
    """0.5 x^2 - 3 x y + 2 y at (2, -1)."""
    polynomial = Polynomial(2, 2, [[0.0, 0.0, 2.0, 0.5, -3.0, 0.0]])
    value, jacobian = evaluate(polynomial, np.array([[2.0], [-1.0]]))
    assert value.item() == 6.0
    np.testing.assert_array_equal(jacobian[0, :, 0], [5.0, -4.0])


def test_zero_is_zero():
    polynomial = Polynomial.zero(2, 3, 4)
    value, jacobian = evaluate(polynomial, np.ones((2, 5)))
    assert value.shape == (3, 5)
    assert jacobian.shape == (3, 2, 5)
    assert not value.any()
    assert not jacobian.any()


@pytest.mark.parametrize("shape", [(1, 5), (1, 7), (6,)])
def test_coefficients_that_do_not_fit_are_refused(shape):
    with pytest.raises(InputError, match=r"must have shape \(m, 6\)"):
        Polynomial(2, 2, np.zeros(shape))


@pytest.mark.parametrize("inputs", [1, 3])
def test_another_number_of_inputs_is_refused(inputs):
    with pytest.raises(ValueError, match="zip"):
        evaluate(Polynomial.zero(2, 1, 2), np.zeros((inputs, 4)))
