"""One step of every method against a hand-written one and against diffrax."""

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.arrays import float64
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER, HEUN, MIDPOINT, RALSTON, RK4, ButcherTableau

BOGACKI = ButcherTableau("bogacki", 3, ((0.5,), (0.0, 0.75)), (2 / 9, 1 / 3, 4 / 9))


class Given:
    """A field that is a plain function, over a step of its own width."""

    def __init__(self, function, width):
        self.function, self.width = function, width

    def __call__(self, x, sample=0, fraction=0.0, part=None):
        return self.function(x)


def step_of(table, function, x, width):
    return RungeKutta(table).advance(Given(function, width), x[None])


def van_der_pol(x):
    return np.stack([x[1], 2.0 * (1.0 - x[0] ** 2) * x[1] - x[0]])


@pytest.fixture
def states(rng):
    return rng.normal(size=(2, 60))


def test_euler_is_x_plus_h_f(states):
    expected = states + 0.03 * van_der_pol(states)
    np.testing.assert_array_equal(step_of(EULER, van_der_pol, states, 0.03), expected)


def test_rk4_is_the_textbook_formula(states):
    h = 0.2
    k1 = van_der_pol(states)
    k2 = van_der_pol(states + h / 2 * k1)
    k3 = van_der_pol(states + h / 2 * k2)
    k4 = van_der_pol(states + h * k3)
    expected = states + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    found = step_of(RK4, van_der_pol, states, h)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("tableau", "solver"),
    [
        (EULER, diffrax.Euler()),
        (HEUN, diffrax.Heun()),
        (MIDPOINT, diffrax.Midpoint()),
        (RALSTON, diffrax.Ralston()),
        (BOGACKI, diffrax.Bosh3()),
    ],
    ids=["euler", "heun", "midpoint", "ralston", "bogacki"],
)
def test_steps_agree_with_diffrax(tableau, solver, states):
    def field(t, x, args):
        return args * x[::-1] * (1.0 - x**2)

    with float64():
        terms, h = diffrax.ODETerm(field), 0.1
        start = jnp.asarray(states)
        state = solver.init(terms, 0.0, h, start, 1.5)
        expected = solver.step(terms, 0.0, h, start, 1.5, state, made_jump=False)[0]
        found = step_of(tableau, lambda x: field(None, x, 1.5), states, h)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_slopes_of_weight_zero_are_not_added(states):
    """A zero weight times a slope that overflowed would be nan."""

    def breaks_after_the_start(x):
        return van_der_pol(x) if np.array_equal(x, states) else np.full_like(x, np.inf)

    table = ButcherTableau("first slope only", 1, ((1.0,),), (1.0, 0.0))
    found = step_of(table, breaks_after_the_start, states, 0.1)
    np.testing.assert_array_equal(found, states + 0.1 * van_der_pol(states))
