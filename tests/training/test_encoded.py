"""Starts by an encoder: terms by a twin in NumPy, complex steps through it, and what is found."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from tests.training.test_outputs import (
    RAW,
    RUN,
    SEEN,
    STEP,
    Hidden,
    Oscillator,
    Position,
    Seen,
    read,
    recorded,
    stepped,
)

from penode import InputError, Predictor, identify, ladder_plan
from penode.arrays import float64
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

PAST, HORIZON, SCALE = 4, 6, 0.5
STARTS = np.arange(PAST - 1, 300, 7)
STRAIN, POWER = read(SEEN, RUN.stack(("x", "v")).T, RUN.channels["u"])
SENSED = replace(RUN, channels={**RUN.channels, "strain": STRAIN, "power": POWER})


def residual(raw, known, names):
    """Return scaled errors (step, output, window) of a raw vector: the encoder's start, run ahead.

    The first `known` entries are the physical parameters.
    """
    physical, rest = raw[:known], raw[known:]
    seen, u = [SENSED.channels[name] for name in names], SENSED.channels["u"]
    past = [STARTS - j for j in range(PAST)]
    rows = [(one[at] - one.mean()) / one.std() for at in past for one in (*seen, u)]
    features = np.array([np.ones(len(STARTS)), *rows])
    width = len(features)
    x, rest = rest[: 2 * width].reshape(2, width) @ features, rest[2 * width :]
    if len(rest):
        count = len(rest) // (width + 2)
        layer, gains = rest[: count * width].reshape(count, width), rest[count * width :]
        x = x + gains.reshape(2, count) @ np.tanh(layer @ features)
    errors = []
    for k in range(HORIZON + 1):
        push = u[STARTS + k]
        if k or len(names) > 1:  # the first sample of outputs counts
            predicted = x[:1] if len(names) == 1 else read(physical, x, push)
            errors.append((np.array([one[STARTS + k] for one in seen]) - predicted) / SCALE)
        x = stepped(physical, x, push, 1)
    return np.array(errors)


@pytest.mark.usefixtures("quickly_compiled")
@pytest.mark.parametrize(
    ("model", "names", "neurons"),
    [
        (Hidden(*RAW), ("x",), 0),
        (Seen(*SEEN), ("strain", "power"), 0),
        (Seen(*SEEN), ("strain", "power"), 3),
    ],
)
def test_terms_and_gradient_are_those_of_the_twin(model, names, neurons):
    """At weights that are no minimum."""
    encoded = Encoded(model, [SENSED], PAST, neurons)
    objective = Objective(Predictor(STEP, DEFAULT_SOLVER), encoded, np.full(2, SCALE))
    raw = objective.layout.raw(encoded)
    raw = raw + 0.05 * np.random.default_rng(1).normal(size=len(raw))
    known = len(objective.layout.physical)
    states, outputs = SENSED.stack(("x", "v")), SENSED.stack(tuple(model.outputs))
    inputs = SENSED.stack(("u",))
    windows = Windows(
        states, inputs, STARTS, 0 * STARTS, HORIZON, PAST, STEP, outputs if model.outputs else None
    )
    expected = residual(raw, known, names)
    slopes = [residual(raw + 1e-30j * row, known, names).imag for row in np.eye(len(raw))]
    jacobian = -np.stack(slopes) / 1e-30
    terms = objective.gauss_newton(raw, windows)
    normal = np.einsum("ikqw,jkqw->ij", jacobian, jacobian)
    descent = np.einsum("ikqw,kqw->i", jacobian, expected)
    assert terms.loss * terms.count == pytest.approx(np.sum(expected**2), rel=1e-10)
    np.testing.assert_allclose(terms.normal, normal, rtol=0, atol=1e-10 * normal.max())
    np.testing.assert_allclose(terms.descent, descent, rtol=0, atol=1e-10 * abs(descent).max())
    loss, gradient = objective.loss_and_gradient(raw, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-10)
    np.testing.assert_allclose(gradient, -2 * descent / terms.count, rtol=1e-8, atol=1e-12)


def test_windows_begin_where_the_encoder_has_its_past():
    encoded = Encoded(Hidden(*RAW), [RUN], 12)
    plan = default_plan(encoded, [RUN])
    problem = LadderProblem.of(encoded, [RUN], plan, ignore_events)
    assert problem.problem(plan.stages[0], plan).windows.starts.min() >= 11


def test_errors_that_an_encoder_begins_are_no_filtered_one_step_errors():
    alone, encoded = (
        Objective(Predictor(STEP), one, np.full(2, SCALE)).error
        for one in (Oscillator(*RAW), Encoded(Oscillator(*RAW), [RUN], 4))
    )
    assert alone.is_filtered_one_step
    assert not encoded.is_filtered_one_step
    assert encoded.past == 4


def test_training_begins_at_what_is_measured():
    encoded = Encoded(Hidden(*RAW), [RUN], 12)
    measured = np.array([[0.3, -0.2]])[None].repeat(12, axis=0)
    with float64():
        start = with_batch_axis(encoded).encoded(jnp.asarray(measured), 0.0 * measured)
    np.testing.assert_allclose(start, [[0.3, -0.2], [0.0, 0.0]], atol=1e-12)


@pytest.mark.slow
def test_parameters_are_found_whose_intervals_hold_the_truth():
    run = recorded(800)
    model = Encoded(Position(1.2, 0.1), [run], 10, neurons=4)
    fit = identify(model, [run], plan=ladder_plan((15, 40, 100)))
    assert fit.horizon.answered
    for name, truth in zip(("k", "c"), RAW, strict=True):
        low, high = fit.parameters[name].interval_95
        assert low < truth < high
        assert high - low < 0.2 * truth


def test_what_is_impossible_is_refused():
    model = Hidden(*RAW)
    with pytest.raises(InputError, match="past must be >= 1 and neurons >= 0, got 0 and 0"):
        Encoded(model, [RUN], 0)
    with pytest.raises(InputError, match=r"one time step, got 0.1 and 0.2 s"):
        Encoded(model, [RUN, replace(RUN, time_step=0.2)], 4)
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
