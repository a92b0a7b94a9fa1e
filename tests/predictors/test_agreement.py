"""Every solver against an implementation of somebody else, over many steps of a driven system.

The table `REFERENCES` says which one each solver is compared with: diffrax at a constant step where
it has the method, `scipy.optimize.root` on the equation of an implicit method, torchdiffeq for the
3/8 rule, and otherwise the textbook's formula written out. Each works on its own NumPy, JAX or
torch version of the equation.
"""

from functools import partial
from typing import ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import RK23, RK45
from scipy.optimize import root

from penode import Model, Predictor, physical
from penode.arrays import float64
from penode.models.parameters import with_batch_axis
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.holds import FirstOrderHold, ZeroOrderHold
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import (
    ADAMS_BASHFORTH,
    DOPRI5,
    RK3,
    RK4,
    RK4_38,
    RUNGE_KUTTA,
    ButcherTableau,
)

STEPS, WIDTH = 60, 0.1
MU, CUBIC = 1.4, 0.8
TIME = WIDTH * np.arange(STEPS + 1)


def push(t):
    return 1.5 * np.sin(1.1 * t) + 0.4 * np.cos(5.0 * t)


PUSH = push(TIME)
#: Samples to each side that a band-limited hold looks at, and the recording with them.
MARGIN = 64
LONGER = push(WIDTH * np.arange(-MARGIN, STEPS + 1 + MARGIN))
START = np.array([0.7, -0.4])
TOLERANCE = 1e-10


class VanDerPolDuffing(Model):
    """x'' = u + mu (1 - x^2) x' - x - c x^3: a limit cycle, driven."""

    states: ClassVar[tuple[str, ...]] = ("x", "v")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s")

    mu: object = physical("1/s")
    cubic: object = physical("1/s2")

    def derivative(self, x, u):
        bend = self.mu * (1.0 - x[0] ** 2) * x[1]
        return jnp.stack([x[1], u[0] + bend - x[0] - self.cubic * x[0] ** 3])


def slope(x, u):
    return np.array([x[1], u + MU * (1 - x[0] ** 2) * x[1] - x[0] - CUBIC * x[0] ** 3])


def held(k, share):
    return PUSH[k]


def straight(k, share):
    return (1 - share) * PUSH[k] + share * PUSH[k + 1]


def as_it_was(k, share):
    return push(TIME[k] + share * WIDTH)


def by_penode(solver, hold, measured):
    """Return the path (time, state) from the first `past` rows of `measured`."""
    with float64():
        predictor = Predictor(WIDTH, solver, hold)
        model = with_batch_axis(VanDerPolDuffing(MU, CUBIC))
        rows = jnp.asarray(predictor.prepared(LONGER[:, None])[MARGIN:])

        @jax.jit
        def step(history, k):
            return predictor.step(model, history, lambda offset: rows[k + offset][:, None])

        path = [*measured[: predictor.past]]
        history = jnp.asarray(np.array(path[::-1]))[..., None]
        for k in range(predictor.past - 1, STEPS):
            history = step(history, k)
            path.append(np.asarray(history[0, :, 0]))
    return np.array(path)


def by_diffrax(solver, u_of, measured):
    """Take single steps of diffrax, which then cannot look past a jump of the input."""

    def field(t, x, k_and_t0):
        u, ahead, t0 = k_and_t0
        if u_of is straight:
            u = u + (ahead - u) * (t - t0) / WIDTH
        if u_of is as_it_was:
            u = 1.5 * jnp.sin(1.1 * t) + 0.4 * jnp.cos(5.0 * t)
        bend = MU * (1.0 - x[0] ** 2) * x[1]
        return jnp.stack([x[1], u + bend - x[0] - CUBIC * x[0] ** 3])

    with float64():
        term, path = diffrax.ODETerm(field), [jnp.asarray(START)]

        @jax.jit
        def step(x, given):
            t0 = given[2]
            state = solver.init(term, t0, t0 + WIDTH, x, given)
            return solver.step(term, t0, t0 + WIDTH, x, given, state, made_jump=True)[0]

        for k in range(STEPS):
            path.append(step(path[-1], jnp.array([PUSH[k], PUSH[k + 1], TIME[k]])))
    return np.array(path)


def by_formula(formula, u_of, measured):
    """Repeat ``formula(f, x)``, f(x, share) being the derivative at a share of the step."""
    path = [START]
    for k in range(STEPS):
        path.append(formula(lambda x, share, k=k: slope(x, u_of(k, share)), path[-1]))
    return np.array(path)


def kutta3(f, x):
    """Kutta's third-order rule: Simpson's with an extrapolated end."""
    a = WIDTH * f(x, 0.0)
    b = WIDTH * f(x + 0.5 * a, 0.5)
    c = WIDTH * f(x - a + 2 * b, 1.0)
    return x + (a + 4 * b + c) / 6


def kutta3_twice_as_fine(f, x):
    """Two steps of half the width."""
    for first in (0.0, 0.5):
        a = 0.5 * WIDTH * f(x, first)
        b = 0.5 * WIDTH * f(x + 0.5 * a, first + 0.25)
        c = 0.5 * WIDTH * f(x - a + 2 * b, first + 0.5)
        x = x + (a + 4 * b + c) / 6
    return x


def classic4(f, x):
    k1 = f(x, 0.0)
    k2 = f(x + WIDTH / 2 * k1, 0.5)
    k3 = f(x + WIDTH / 2 * k2, 0.5)
    k4 = f(x + WIDTH * k3, 1.0)
    return x + WIDTH / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def three_eighths(f, x):
    k1 = f(x, 0.0)
    k2 = f(x + WIDTH * k1 / 3, 1 / 3)
    k3 = f(x + WIDTH * (k2 - k1 / 3), 2 / 3)
    k4 = f(x + WIDTH * (k1 - k2 + k3), 1.0)
    return x + WIDTH / 8 * (k1 + 3 * k2 + 3 * k3 + k4)


def scipys_table(method, f, x):
    """One step with the coefficients that `scipy.integrate` keeps of its own methods."""
    k = np.zeros((method.n_stages, len(x)))
    for s in range(method.n_stages):
        k[s] = f(x + WIDTH * method.A[s, :s] @ k[:s], method.C[s])
    return x + WIDTH * method.B @ k


def implicit_midpoint(f, x):
    def left(z):
        return z - x - WIDTH * f((x + z) / 2, 0.5)

    return polished(left, x)


def trapezoidal(f, x):
    def left(z):
        return z - x - WIDTH / 2 * (f(x, 0.0) + f(z, 1.0))

    return polished(left, x)


def polished(left, x):
    found = root(left, x, tol=1e-14)
    assert np.abs(left(found.x)).max() < 1e-12
    return found.x


def adams_bashforth(order, u_of, measured):
    """Integrate the polynomial through the last slopes, by a Vandermonde system."""
    weights = np.linalg.solve(
        np.vander(-np.arange(order), order, increasing=True).T.astype(float),
        1 / np.arange(1, order + 1),
    )
    path = [*measured[:order]]
    for k in range(order - 1, STEPS):
        slopes = [slope(path[k - j], PUSH[k - j]) for j in range(order)]
        path.append(path[k] + WIDTH * weights @ slopes)
    return np.array(path)


def by_torchdiffeq(u_of, measured):
    """torchdiffeq's ``rk4`` is the 3/8 rule; each sample is one call, so the input stays held."""
    torch = pytest.importorskip("torch", exc_type=ImportError)
    torchdiffeq = pytest.importorskip("torchdiffeq", exc_type=ImportError)
    path = [torch.tensor(START)]
    for k in range(STEPS):

        def field(t, x, u=PUSH[k]):
            return torch.stack([x[1], u + MU * (1 - x[0] ** 2) * x[1] - x[0] - CUBIC * x[0] ** 3])

        ends = torch.tensor([0.0, WIDTH], dtype=torch.float64)
        path.append(torchdiffeq.odeint(field, path[-1], ends, method="rk4")[1])
    return torch.stack(path).numpy()


#: Solver -> the implementations it must agree with.
REFERENCES = {
    "euler": {"diffrax": partial(by_diffrax, diffrax.Euler())},
    "midpoint": {"diffrax": partial(by_diffrax, diffrax.Midpoint())},
    "heun": {"diffrax": partial(by_diffrax, diffrax.Heun())},
    "ralston": {"diffrax": partial(by_diffrax, diffrax.Ralston())},
    "rk3": {"formula": partial(by_formula, kutta3)},
    "rk4": {"formula": partial(by_formula, classic4)},
    "rk4_38": {"formula": partial(by_formula, three_eighths), "torchdiffeq": by_torchdiffeq},
    "dopri5": {
        "diffrax": partial(by_diffrax, diffrax.Dopri5()),
        "scipy": partial(by_formula, partial(scipys_table, RK45)),
    },
    "a table of the user's": {
        "diffrax": partial(by_diffrax, diffrax.Bosh3()),
        "scipy": partial(by_formula, partial(scipys_table, RK23)),
    },
    "sub-steps": {"formula": partial(by_formula, kutta3_twice_as_fine)},
    "implicit midpoint": {"scipy": partial(by_formula, implicit_midpoint)},
    "trapezoidal": {"scipy": partial(by_formula, trapezoidal)},
    **{t.name: {"quadrature": partial(adams_bashforth, t.order)} for t in ADAMS_BASHFORTH},
}

BOGACKI = ButcherTableau("bogacki", 3, ((0.5,), (0.0, 0.75)), (2 / 9, 1 / 3, 4 / 9))
SOLVERS = {
    **{table.name: RungeKutta(table) for table in RUNGE_KUTTA},
    **{table.name: AdamsBashforth(table) for table in ADAMS_BASHFORTH},
    "a table of the user's": RungeKutta(BOGACKI),
    "sub-steps": Substeps(RungeKutta(RK3), 2),
    "implicit midpoint": ImplicitMidpoint(),
    "trapezoidal": Trapezoidal(),
}
PAIRS = [(solver, who) for solver, known in REFERENCES.items() for who in known]


@pytest.fixture(scope="module")
def measured():
    """Return a path that a multistep method may start from."""
    return by_formula(classic4, held, None)


def test_every_solver_has_a_reference():
    assert set(SOLVERS) == set(REFERENCES)


@pytest.mark.parametrize(("name", "who"), PAIRS, ids=lambda x: x)
def test_held_input(name, who, measured):
    expected = REFERENCES[name][who](held, measured)
    found = by_penode(SOLVERS[name], ZeroOrderHold(), measured)
    assert np.ptp(expected) > 3  # it has gone round, so that errors had time to grow
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize(
    ("name", "who"),
    [(n, w) for n, w in PAIRS if w != "torchdiffeq" and not isinstance(SOLVERS[n], AdamsBashforth)],
    ids=lambda x: x,
)
@pytest.mark.parametrize(
    ("u_of", "hold"), [(straight, FirstOrderHold()), (as_it_was, BandLimitedHold())]
)
def test_an_input_that_moves_is_read_at_the_nodes_of_the_method(name, who, u_of, hold, measured):
    """Only an input that moves within the step shows a wrong node."""
    expected = REFERENCES[name][who](u_of, measured)
    found = by_penode(SOLVERS[name], hold, measured)
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE)


def test_methods_of_one_order_are_told_apart(measured):
    """The tolerance is far below what parts neighbouring methods on this problem."""
    four, three_eighth = (
        by_penode(RungeKutta(t), ZeroOrderHold(), measured) for t in (RK4, RK4_38)
    )
    five = by_penode(RungeKutta(DOPRI5), ZeroOrderHold(), measured)
    assert np.abs(four - three_eighth).max() > 1e4 * TOLERANCE
    assert np.abs(four - five).max() > 1e4 * TOLERANCE
