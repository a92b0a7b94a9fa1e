"""An interval that is infinite says why, and none is narrow that no window sees."""

import jax.numpy as jnp
import numpy as np
import pytest
from tests.horizon.test_default_plan import Lag
from tests.horizon.test_simulation import lag

from penode import identify, physical
from penode.arrays import Leaf
from penode.training.covariance import undetermined
from penode.training.gauss_newton_terms import GaussNewtonTerms


class Product(Lag):
    """x' = a b (u - x): a and b are seen as their product alone."""

    b: Leaf = physical("")

    def derivative(self, x, u):
        return self.a * self.b * (u[0] - x[0])[None]


class Beyond(Lag):
    """x' = a (u - x) - c max(x - 50, 0), where x is never above 5."""

    c: Leaf = physical("1/s")

    def derivative(self, x, u):
        return (self.a * (u[0] - x[0]) - self.c * jnp.maximum(x[0] - 50.0, 0.0))[None]


def test_parameters_that_the_data_do_not_tell_apart_have_no_interval():
    fit = identify(Product(1.0, 2.0), [lag()])
    for name in ("a", "b"):
        assert fit.parameters[name].std == np.inf
        assert any(
            w.startswith("The interval of a, b is infinite: a and b act only together")
            for w in fit.warnings
        )


def test_a_parameter_that_nothing_excites_has_none_and_spoils_no_other():
    fit = identify(Beyond(1.0, 2.0), [lag()])
    assert fit.parameters["c"].std == np.inf
    assert any(
        w.startswith("The interval of c is infinite: no prediction depends on it")
        for w in fit.warnings
    )
    assert fit.parameters["a"].value == pytest.approx(3.0, rel=0.05)
    assert 0 < fit.parameters["a"].std < 0.1


def test_a_direction_without_curvature_is_found_whatever_the_scales(rng):
    """Columns 0 and 2 are proportional, of very different size; 1 is seen, 3 is not."""
    root = rng.normal(size=(50, 4)) * [1.0, 1e-6, 0.0, 0.0]
    root[:, 2] = 1e4 * root[:, 0]
    normal = root.T @ root
    terms = GaussNewtonTerms(1.0, 50, normal, np.zeros(4), np.zeros((4, 50)))
    expected = np.zeros((4, 4), bool)
    expected[np.ix_([0, 2], [0, 2])] = expected[3, 3] = True
    np.testing.assert_array_equal(undetermined(terms, np.eye(4)), expected)
