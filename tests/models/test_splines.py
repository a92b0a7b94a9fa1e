"""Splines against scipy, what they span, how smooth they are, and where they end."""

from itertools import product

import jax
import numpy as np
import pytest
from scipy.interpolate import BSpline, NdBSpline

from penode import InputError
from penode.arrays import float64
from penode.models.compositions import Gradient, LinearSkip
from penode.models.parameters import with_batch_axis
from penode.models.splines import Spline, cubic_kernel

#: low, high, cells of boxes with one to three inputs
BOXES = {
    "one input": ((-2.0,), (3.0,), (7,)),
    "one cell": ((0.5,), (0.75,), (1,)),
    "two inputs": ((-1.0, -200.0), (1.5, 100.0), (5, 4)),
    "three inputs": ((-1.0, 0.0, 2.0), (1.0, 1.0, 5.0), (2, 1, 3)),
}
over_boxes = pytest.mark.parametrize(("low", "high", "cells"), BOXES.values(), ids=BOXES)

#: Columns of every evaluation, so that each box is compiled once.
BATCH = 120


def drawn(low, high, cells, rng):
    return Spline(low, high, cells, rng.normal(size=(1, *(count + 3 for count in cells))))


@jax.jit
def compiled(spline, x):
    value, gradient = spline.value_and_jacobian(x)
    return value[0], gradient[0], Gradient(spline).value_and_jacobian(x)[1]


def evaluate(spline, x):
    """Return value (batch,), gradient (n, batch) and Hessian (n, n, batch) of one output."""
    padded = np.pad(x, ((0, 0), (0, BATCH - x.shape[1])), mode="edge")
    with float64():
        parts = compiled(with_batch_axis(spline), padded)
    return [np.asarray(part)[..., : x.shape[1]] for part in parts]


def widths(spline):
    return (np.array(spline.high) - spline.low) / spline.cells


def points(spline, rng):
    """Draw columns in the box, after all its knots."""
    axes = zip(spline.low, spline.high, spline.cells, strict=True)
    knots = np.array(list(product(*(np.linspace(a, b, n + 1) for a, b, n in axes)))).T
    count = BATCH - knots.shape[1]
    low, high = np.array(spline.low)[:, None], np.array(spline.high)[:, None]
    return np.concatenate([knots, low + (high - low) * rng.random((len(low), count))], axis=1)


def knots_of(spline):
    axes = zip(spline.low, widths(spline), spline.cells, strict=True)
    return tuple(low + width * np.arange(-3, count + 4) for low, width, count in axes)


def test_the_kernel_is_scipys_basis_element():
    t = np.linspace(-3, 3, 1201)
    twin = BSpline.basis_element(np.arange(-2.0, 3.0), extrapolate=False)
    with float64():
        value, slope = cubic_kernel(t)
    np.testing.assert_allclose(value, np.nan_to_num(twin(t)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(slope, np.nan_to_num(twin.derivative()(t)), rtol=0, atol=1e-14)


def test_one_input_agrees_with_scipys_bspline(rng):
    spline = drawn(*BOXES["one input"], rng)
    x = points(spline, rng)
    value, gradient, _ = evaluate(spline, x)
    twin = BSpline(*knots_of(spline), spline.coefficients[0], 3)
    np.testing.assert_allclose(value, twin(x[0]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(gradient[0], twin.derivative()(x[0]), rtol=0, atol=1e-12)


@over_boxes
def test_value_gradient_and_curvature_agree_with_scipy_at_knots_too(low, high, cells, rng):
    """A derivative of |t| taken as zero at t = 0 would make the curvature wrong at knots."""
    spline = drawn(low, high, cells, rng)
    x = points(spline, rng)
    value, gradient, hessian = evaluate(spline, x)
    twin = NdBSpline(knots_of(spline), spline.coefficients[0], 3)
    order, width = np.eye(len(cells), dtype=int), widths(spline)
    np.testing.assert_allclose(value, twin(x.T), rtol=0, atol=1e-12)
    for i in range(len(cells)):
        expected = width[i] * twin(x.T, nu=order[i])
        np.testing.assert_allclose(width[i] * gradient[i], expected, rtol=0, atol=1e-12)
    for i, j in product(range(len(cells)), repeat=2):
        expected = width[i] * width[j] * twin(x.T, nu=order[i] + order[j])
        found = width[i] * width[j] * hessian[i, j]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


@over_boxes
def test_cubic_polynomials_are_reproduced_in_the_box(low, high, cells, rng):
    """Fitted to a product of cubics at some points, met at others."""
    spline = drawn(low, high, cells, rng)
    middle = (np.array(low) + high)[:, None] / 2
    weights = rng.normal(size=(len(low), 4))

    def cubic(x):
        scaled = (x - middle) / (np.array(high)[:, None] - middle)
        rows = zip(scaled, weights, strict=True)
        return np.prod([np.polynomial.polynomial.polyval(*row) for row in rows], axis=0)

    axes = zip(low, high, cells, strict=True)
    grid = np.array(list(product(*(np.linspace(a, b, n + 3) for a, b, n in axes))))
    design = NdBSpline.design_matrix(grid, knots_of(spline), [3] * len(low)).toarray()
    fitted = np.linalg.solve(design, cubic(grid.T)).reshape(spline.coefficients.shape)
    x = points(spline, rng)
    value, _, _ = evaluate(Spline(low, high, cells, fitted), x)
    np.testing.assert_allclose(value, cubic(x), rtol=0, atol=1e-11)


@pytest.mark.parametrize("knot", range(-3, 11))
def test_two_derivatives_are_continuous_and_the_third_jumps(knot, rng):
    """At every knot, those beyond the box included, from the cubics on both sides."""
    spline = drawn(*BOXES["one input"], rng)
    around, sides = np.array([0.1, 0.2, 0.3, 0.4]), []
    for side in (-1, 1):
        value, _, _ = evaluate(spline, -2.0 + (knot + side * around)[None] * widths(spline))
        sides.append(np.polynomial.polynomial.polyfit(side * around, value, 3))
    np.testing.assert_allclose(sides[0][:3], sides[1][:3], rtol=0, atol=1e-11)
    assert abs(sides[0][3] - sides[1][3]) > 1e-3


@over_boxes
def test_it_falls_to_zero_within_three_cells_beyond_the_box(low, high, cells, rng):
    spline = drawn(low, high, cells, rng)
    middle = (np.array(low) + high) / 2
    distance = np.array([2.5, 3.0 + 1e-9, 3.5, 10.0, 1e6])
    for i, (edge, side) in product(range(len(cells)), ((low, -1), (high, 1))):
        x = np.repeat(middle[:, None], len(distance), axis=1)
        x[i] = edge[i] + side * distance * widths(spline)[i]
        value, gradient, hessian = evaluate(spline, x)
        assert value[0] != 0
        assert not value[1:].any()
        assert not gradient[:, 1:].any()
        assert not hessian[..., 1:].any()


def test_with_a_linear_skip_it_continues_linearly(rng):
    spline = Spline((-1.0,), (1.0,), (4,), rng.normal(size=(2, 7)))
    matrix, offset, x = rng.normal(size=(2, 1)), rng.normal(size=2), np.array([[9.0, -9.0]])
    with float64():
        network = with_batch_axis(LinearSkip(spline, matrix, offset))
        value, jacobian = jax.jit(LinearSkip.value_and_jacobian)(network, x)
    np.testing.assert_allclose(value, matrix @ x + offset[:, None], rtol=1e-14)
    np.testing.assert_array_equal(jacobian, np.repeat(matrix[..., None], 2, axis=2))


def test_zero_is_zero_and_settings_become_tuples():
    spline = Spline.zero(np.array([-1.0, 0.0]), [1, 2], np.array([2, 3]), outputs=3)
    assert spline.coefficients.shape == (3, 5, 6)
    assert not spline.coefficients.any()
    assert (spline.low, spline.high, spline.cells) == ((-1.0, 0.0), (1.0, 2.0), (2, 3))


@pytest.mark.parametrize(
    ("low", "high", "cells", "said"),
    [
        ((0.0,), (0.0,), (2,), "low must be below high"),
        ((0.0,), (-1.0,), (2,), "low must be below high"),
        ((0.0,), (float("nan"),), (2,), "low must be below high"),
        ((0.0,), (float("inf"),), (2,), "low must be below high"),
        ((0.0,), (1.0,), (0,), "cells must be >= 1"),
        ((0.0, 0.0), (1.0,), (2,), "must be one an input"),
    ],
)
def test_an_empty_box_is_refused(low, high, cells, said):
    with pytest.raises(InputError, match=said):
        Spline.zero(low, high, cells, outputs=1)


def test_coefficients_that_do_not_fit_the_cells_are_refused():
    with pytest.raises(InputError, match="three more than cells"):
        Spline((0.0,), (1.0,), (4,), np.zeros((2, 5)))


@pytest.mark.parametrize("inputs", [1, 3])
def test_another_number_of_inputs_is_refused(inputs):
    with pytest.raises(ValueError, match="zip"):
        Spline.zero((0, 0), (1, 1), (2, 2), 1).value_and_jacobian(np.zeros((inputs, 4)))
