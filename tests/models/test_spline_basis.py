"""Splines on warped knots: SciPy's as reference, and the parabola beyond the ends."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

from penode.arrays import float64
from penode.errors import InputError
from penode.models.spline_basis import DEGREE, SplineBasis, splines_of_each


def splines(basis, x):
    return splines_of_each([basis], jnp.asarray(x)[None])[:, 0]


@pytest.mark.parametrize("count", [5, 7, 15])
def test_splines_and_derivatives_are_those_of_scipy(count):
    basis = SplineBasis(count, 0.3)
    x = np.linspace(-1.0, 1.0, 301)
    each = [BSpline(basis.knots, row, DEGREE) for row in np.eye(count)]
    with float64():
        compiled = np.asarray(splines(basis, x))
    for order, found in enumerate(basis.derivatives(x)):
        wanted = np.stack([spline(x, nu=order) for spline in each])
        np.testing.assert_allclose(found, wanted, atol=5e-13 * np.abs(wanted).max())
        if order < len(compiled):
            np.testing.assert_allclose(compiled[order], wanted, atol=5e-13 * np.abs(wanted).max())


def test_knots_lie_densest_at_zero_and_end_at_one():
    width = np.diff(SplineBasis(15, 0.3).breaks)
    assert width.argmin() == len(width) // 2
    assert width.max() > 2 * width.min()
    np.testing.assert_allclose(SplineBasis(15, 0.3).breaks[[0, -1]], [-1.0, 1.0])


def test_beyond_the_ends_a_spline_is_the_parabola_that_touches():
    basis, beyond = SplineBasis(9, 0.5), np.array([-1.7, -1.2, 1.1, 1.5])
    with float64():
        at_end = np.asarray(splines(basis, np.sign(beyond)))
        found = np.asarray(splines(basis, beyond))
    assert np.all(basis.derivatives(beyond)[3] == 0.0)
    step = beyond - np.sign(beyond)
    value = at_end[0] + at_end[1] * step + at_end[2] * step**2 / 2
    np.testing.assert_allclose(found[0], value, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found[1], at_end[1] + at_end[2] * step, rtol=1e-12, atol=1e-12)


def test_each_derivative_differentiates_to_the_next():
    basis = SplineBasis(7, 0.3)
    x = np.linspace(-1.3, 1.3, 26)  # no end of the splines among them
    with float64():
        at = jnp.asarray(x)
        _, slopes = jax.jvp(partial(splines, basis), (at,), (jnp.ones_like(at),))
    expected = basis.derivatives(x)[1:]
    np.testing.assert_allclose(slopes, expected, atol=1e-12 * np.abs(expected).max())


def test_quadrature_integrates_products_of_splines():
    basis = SplineBasis(8, 0.4)
    places, weights = basis.quadrature()
    value = basis.derivatives(places)[0]
    fine = np.linspace(-1.0, 1.0, 200_001)
    dense = basis.derivatives(fine)[0]
    expected = np.trapezoid(dense[2] * dense[4], fine)
    assert np.sum(weights * value[2] * value[4]) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("basis", [(4, 0.3), (9, 0.0)])
def test_a_basis_without_cells_or_sharpness_is_refused(basis):
    with pytest.raises(InputError, match="at least 5 splines and a sharpness above 0"):
        SplineBasis(*basis)
