"""Compositions against the same composition written in NumPy, and what they refuse."""

import jax
import numpy as np
import pytest

from penode import InputError
from penode.arrays import float64
from penode.models.compositions import Gradient, LinearSkip, Scaled
from penode.models.layout import Layout
from penode.models.networks import ConvexGradient, TanhLayers
from penode.models.parameters import with_batch_axis
from penode.models.polynomials import Polynomial


@jax.jit
def compiled(network, x):
    return network.value_and_jacobian(x)


def evaluate(network, x):
    with float64():
        value, jacobian = compiled(with_batch_axis(network), x)
    return np.asarray(value), np.asarray(jacobian)


def traced(network, x):
    """Go through the evaluation without computing it."""
    jax.eval_shape(lambda x: with_batch_axis(network).value_and_jacobian(x), x)


def test_linear_skip_adds_a_linear_map(rng):
    network, x = TanhLayers.random((2, 5, 3), seed=1), rng.normal(size=(2, 20))
    matrix, offset = rng.normal(size=(3, 2)), rng.normal(size=3)
    value, jacobian = evaluate(network, x)
    total, slope = evaluate(LinearSkip(network, matrix, offset), x)
    np.testing.assert_allclose(total, value + matrix @ x + offset[:, None], rtol=0, atol=1e-14)
    np.testing.assert_allclose(slope, jacobian + matrix[..., None], rtol=0, atol=1e-14)


def test_gradient_of_an_energy_by_hand():
    """x^2 y + 3 y^3 at (2, -1): (2 x y, x^2 + 9 y^2) and ((2 y, 2 x), (2 x, 18 y))."""
    energy = Polynomial(2, 3, [[0, 0, 0, 0, 0, 0, 0, 1, 0, 3]])
    value, jacobian = evaluate(Gradient(energy), np.array([[2.0], [-1.0]]))
    np.testing.assert_array_equal(value[:, 0], [-4.0, 13.0])
    np.testing.assert_array_equal(jacobian[..., 0], [[-2.0, 4.0], [4.0, -18.0]])


def test_gradient_carries_the_parameters_of_its_potential():
    potential = Polynomial.zero(2, 1, 3)
    assert Layout(Gradient(potential)).names == ("potential.coefficients",)
    assert Layout(Gradient(potential)).size == 10


@pytest.mark.parametrize(
    "potential", [ConvexGradient.random(2, 3, 0), Polynomial.zero(2, 3, 2)], ids=["two", "three"]
)
def test_a_potential_with_more_than_one_output_is_refused(potential):
    with pytest.raises(InputError, match="a potential must have one output"):
        traced(Gradient(potential), np.zeros((2, 4)))


def test_scaled_divides_inputs_and_multiplies_outputs(rng):
    network, x = TanhLayers.random((2, 5, 3), seed=1), rng.normal(size=(2, 20))
    inner, outer = np.array([100.0, 0.1]), np.array([2.0, -3.0, 1e-3])
    value, jacobian = evaluate(network, x)
    total, slope = evaluate(Scaled(network, inner, list(outer)), inner[:, None] * x)
    np.testing.assert_allclose(total, outer[:, None] * value, rtol=1e-12)
    np.testing.assert_allclose(slope, outer[:, None, None] * jacobian / inner[:, None], rtol=1e-12)


def test_scales_are_settings_and_not_parameters():
    network = TanhLayers.random((2, 5, 3), seed=1)
    scaled = Scaled(network, np.array([2, 3]), [1, 1, 1])
    assert scaled.input_scale == (2.0, 3.0)
    assert scaled.output_scale == (1.0, 1.0, 1.0)
    assert Layout(scaled).size == Layout(network).size


@pytest.mark.parametrize("wrong", [0.0, float("nan"), float("inf")])
def test_scales_that_are_zero_or_not_finite_are_refused(wrong):
    for scales in (((wrong, 1.0), (1.0,)), ((1.0, 1.0), (wrong,))):
        with pytest.raises(InputError, match="finite"):
            Scaled(Polynomial.zero(2, 1, 2), *scales)


@pytest.mark.parametrize(
    ("inner", "outer", "said"),
    [
        ((1.0,), (1.0, 1.0), "input_scale must be 2 numbers"),
        ((1.0, 1.0), (1.0,), "output_scale must be 2 numbers"),
    ],
)
def test_one_scale_is_not_stretched_over_many(inner, outer, said):
    with pytest.raises(InputError, match=said):
        traced(Scaled(Polynomial.zero(2, 2, 2), inner, outer), np.zeros((2, 4)))
