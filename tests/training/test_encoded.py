"""Starts by an encoder: terms by a twin in NumPy, complex steps through it, and what is found."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from penode import Experiment, InputError, Model, Predictor, identify, ladder_plan, physical
from penode.arrays import Leaf, float64
from penode.data.windows import Windows
from penode.engine import (
    AdamsBashforth,
    Encoded,
    ExtendedKalman,
    default_plan,
    with_batch_axis,
)
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.tableaus import AB2
from penode.training.residuals import Objective

STEP, PAST, HORIZON = 0.1, 4, 6
TRUE = {"k": 4.0, "c": 0.4}


class Oscillator(Model):
    """x'' = u - k x - c x', the speed not measured."""

    states: ClassVar = ("x", "v")
    inputs: ClassVar = ("u",)
    state_units: ClassVar = ("m", "m/s")
    unmeasured: ClassVar = ("v",)

    k: Leaf = physical("1/s2")
    c: Leaf = physical("1/s")

    def derivative(self, x, u):
        return jnp.stack([x[1], u["u"] - self.k * x[0] - self.c * x[1]])


class Tip(Oscillator):
    """The same by a sensor, which reads a sum of both states and the input."""

    unmeasured: ClassVar = ()
    outputs: ClassVar = {"tip": "m"}

    def output(self, x, u):
        return jnp.stack([x[0] + 0.3 * x[1] + 0.02 * u["u"]])


def recorded(samples=600, noise=0.02, seed=3):
    """Record an oscillator whose input is held from sample to sample."""
    random = np.random.default_rng(seed)
    u = random.normal(0, 2, samples // 10).repeat(10)
    flow = np.zeros((3, 3))
    flow[:2] = [[0, 1, 0], [-TRUE["k"], -TRUE["c"], 1]]
    ahead, state, path = expm(flow * STEP), np.zeros(2), []
    for push in u:
        path.append(state)
        state = ahead[:2, :2] @ state + ahead[:2, 2] * push
    x, v = np.array(path).T
    channels = {"x": x, "tip": x + 0.3 * v + 0.02 * u}
    noisy = {name: one + noise * random.normal(size=samples) for name, one in channels.items()}
    return Experiment("run", STEP, {**noisy, "u": u})


RUN = recorded()
STARTS = np.arange(PAST - 1, 500, 7)


def perturbed(model, neurons):
    """Return the encoded model with weights that are no minimum, and its raw vector."""
    encoded = Encoded(model, [RUN], PAST, neurons)
    scale = np.full(len(encoded.outputs) or 2, 0.5)
    objective = Objective(Predictor(STEP, DEFAULT_SOLVER), encoded, scale)
    raw = objective.layout.raw(encoded)
    return encoded, objective, raw + 0.05 * np.random.default_rng(1).normal(size=len(raw))


def residual(encoded, raw, name):
    """Return scaled errors (window, step) of a raw vector: what the encoder says, run ahead."""
    k, c, rest = raw[0], raw[1], raw[2:]
    y, u = RUN.channels[name], RUN.channels["u"]
    width = 1 + 2 * PAST
    weights, rest = rest[: 2 * width].reshape(2, width), rest[2 * width :]
    past = [STARTS - j for j in range(PAST)]
    rows = [(one[at] - one.mean()) / one.std() for at in past for one in (y, u)]
    features = np.array([np.ones(len(STARTS)), *rows])
    x = weights @ features
    if len(rest):
        count = len(rest) // (width + 2)
        layer, gains = rest[: count * width].reshape(count, width), rest[count * width :]
        x = x + gains.reshape(2, count) @ np.tanh(layer @ features)

    def slope(x, push):
        return np.stack([x[1], push - k * x[0] - c * x[1]])

    errors = []
    for step in range(HORIZON + 1):
        push = u[STARTS + step]
        seen = x[0] if name == "x" else x[0] + 0.3 * x[1] + 0.02 * push
        if step or name != "x":
            errors.append((y[STARTS + step] - seen) / 0.5)
        k1 = slope(x, push)
        k2 = slope(x + STEP / 2 * k1, push)
        k3 = slope(x + STEP / 2 * k2, push)
        x = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + slope(x + STEP * k3, push))
    return np.array(errors).T


@pytest.mark.usefixtures("quickly_compiled")
@pytest.mark.parametrize(
    ("model", "name", "neurons"), [(Oscillator, "x", 0), (Tip, "tip", 0), (Tip, "tip", 3)]
)
def test_terms_and_gradient_are_those_of_the_twin(model, name, neurons):
    encoded, objective, raw = perturbed(model(**TRUE), neurons)
    states = np.column_stack([RUN.channels["x"], 0 * RUN.channels["x"]])
    outputs = RUN.stack(("tip",)) if model is Tip else None
    windows = Windows(states, RUN.stack(("u",)), STARTS, 0 * STARTS, HORIZON, PAST, STEP, outputs)
    expected = residual(encoded, raw, name)
    jacobian = np.stack(
        [-residual(encoded, raw + 1e-30j * row, name).imag / 1e-30 for row in np.eye(len(raw))]
    )
    terms = objective.gauss_newton(raw, windows)
    normal = np.einsum("iwk,jwk->ij", jacobian, jacobian)
    descent = np.einsum("iwk,wk->i", jacobian, expected)
    assert terms.loss * terms.count == pytest.approx(np.sum(expected**2), rel=1e-10)
    np.testing.assert_allclose(terms.normal, normal, rtol=0, atol=1e-10 * normal.max())
    np.testing.assert_allclose(terms.descent, descent, rtol=0, atol=1e-10 * abs(descent).max())
    loss, gradient = objective.loss_and_gradient(raw, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-10)
    np.testing.assert_allclose(gradient, -2 * descent / terms.count, rtol=1e-8, atol=1e-12)


def test_windows_begin_where_the_encoder_has_its_past():
    encoded = Encoded(Oscillator(k=2.0, c=1.0), [RUN], 12)
    plan = default_plan(encoded, [RUN])
    problem = LadderProblem.of(encoded, [RUN], plan, ignore_events)
    assert problem.problem(plan.stages[0], plan).windows.starts.min() >= 11


def test_training_begins_at_what_is_measured():
    encoded = Encoded(Oscillator(k=2.0, c=1.0), [RUN], 12)
    measured = np.array([[0.3, -0.2]])[None].repeat(12, axis=0)
    with float64():
        start = with_batch_axis(encoded).encoded(jnp.asarray(measured), 0.0 * measured)
    np.testing.assert_allclose(start, [[0.3, -0.2], [0.0, 0.0]], atol=1e-12)


def test_parameters_are_found_whose_intervals_hold_the_truth():
    model = Encoded(Tip(k=2.0, c=1.0), [RUN], 10, neurons=4)
    fit = identify(model, [RUN], plan=ladder_plan((15, 40, 100)))
    assert fit.horizon.answered
    for name, truth in TRUE.items():
        low, high = fit.parameters[name].interval_95
        assert low < truth < high
        assert high - low < 0.2 * truth


def test_what_is_impossible_is_refused():
    model = Oscillator(k=2.0, c=1.0)
    with pytest.raises(InputError, match="past must be >= 1 and neurons >= 0, got 0 and 0"):
        Encoded(model, [RUN], 0)
    with pytest.raises(InputError, match=r"starts are to be encoded, but .* choose a one-step"):
        Objective(Predictor(STEP, AdamsBashforth(AB2)), Encoded(model, [RUN], 4), np.full(2, 0.5))
    noisy = ExtendedKalman(model, process=(0.1, 0.1), sensor=(0.02,))
    with pytest.raises(InputError, match="without noise on its states, got ExtendedKalman"):
        Encoded(noisy, [RUN], 4)
    with pytest.raises(InputError, match="windows estimate their starts, got Encoded"):
        ExtendedKalman(Encoded(model, [RUN], 4), process=(0.1, 0.1), sensor=(0.02,))
    short = RUN.part(0, 30)
    with pytest.raises(InputError, match="horizon 25 with 12 past samples needs at least 37"):
        identify(Encoded(model, [short], 12), [short], plan=ladder_plan((25,)))
