"""The recursion against a plain loop."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode import Predictor
from penode.arrays import float64
from penode.models.parameters import with_batch_axis
from penode.predictors.rollout import rollout

STEPS = 40


@pytest.fixture(scope="module")
def case(systems):
    """Return the Duffing system, starts (state, batch) and inputs (input, time, batch)."""
    system = systems["duffing"]
    random = np.random.default_rng(7)
    return system, random.normal(size=(2, 9)), 2.0 * random.normal(size=(1, STEPS, 9))


def by_rollout(case, horizon):
    """Record the predictions, the steps' numbers and what the step hands to the visitor."""
    system, start, inputs = case
    predictor, model = Predictor(system.time_step), with_batch_axis(system.model)

    def step(k, history):
        drive = lambda offset: jnp.asarray(inputs)[:, k + offset]  # noqa: E731
        return predictor.step(model, history, drive), history[0, 0]

    def visit(k, history, extra, carry):
        path, before, count = carry
        return path.at[k].set(history[0]), before.at[k].set(extra), count + 1

    blank = (jnp.zeros((STEPS, 2, 9)), jnp.zeros((STEPS, 9)), jnp.zeros(()))
    return rollout(step, jnp.asarray(start)[None], horizon, visit, blank)


def by_loop(case):
    system, x, inputs = case
    path = []
    for k in range(STEPS):
        x = system.step("rk4", system.raw[:, None], x, inputs[:, k])
        path.append(x)
    return np.array(path)


def test_rollout_is_the_plain_loop(case):
    with float64():
        path, before, count = jax.jit(partial(by_rollout, case, STEPS))()
    expected = by_loop(case)
    np.testing.assert_allclose(path, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(before[0], case[1][0])
    np.testing.assert_array_equal(before[1:], path[:-1, 0])
    assert float(count) == STEPS


def test_static_and_traced_horizons_agree(case):
    """But for rounding: the compiler fuses the two programs differently."""
    with float64():
        traced = jax.jit(partial(by_rollout, case))
        for horizon in (0, 1, 17):
            fixed = jax.jit(partial(by_rollout, case, horizon))()
            for a, b in zip(fixed, traced(horizon), strict=True):
                np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-14)
            assert float(fixed[2]) == horizon
            assert not np.any(fixed[0][horizon:])
