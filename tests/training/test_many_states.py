"""Many states and free starts, whose sums are loops: against linear least squares by NumPy."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Model, Predictor, physical
from penode.arrays import Leaf, float64, on_device
from penode.data.windows import Windows
from penode.native.normal_matrix import NormalMatrix
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training import chunks, free_starts
from penode.training.loss import Loss
from penode.training.prediction_error import compiled_windows
from penode.training.residuals import Objective
from penode.training.sensitivities import _MANY, Recursion, window_sums

MASSES, STEP, HORIZON, COUNT = 10, 0.05, 30, 7
MEASURED = (0, 3, 6, 9)
RAW = np.array([4.0, 0.3])


class Chain(Model):
    """Masses in a row between walls, the first driven, every third one's position measured."""

    states: ClassVar[tuple[str, ...]] = tuple(f"{n}{k}" for n in "xv" for k in range(MASSES))
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m",) * MASSES + ("m/s",) * MASSES
    unmeasured: ClassVar[tuple[str, ...]] = tuple(
        n for k, n in enumerate(states) if k not in MEASURED
    )

    k: Leaf = physical("1/s2")
    c: Leaf = physical("1/s")

    def derivative(self, x, u):
        place, speed = x[:MASSES], x[MASSES:]
        force = self.k * bend(place) + self.c * bend(speed)
        return jnp.concatenate([speed, force.at[0].add(u[0])])


def bend(values):
    padded = jnp.pad(values, ((1, 1), (0, 0)))
    return padded[2:] + padded[:-2] - 2 * values


def squares(raw, windows):
    """Return the least squares of all windows, each with the best of all starts."""
    stiff = np.eye(MASSES, k=1) + np.eye(MASSES, k=-1) - 2 * np.eye(MASSES)
    none, one = np.zeros((MASSES, MASSES)), np.eye(MASSES)
    step = np.eye(2 * MASSES) + STEP * np.block([[none, one], [raw[0] * stiff, raw[1] * stiff]])
    total, free = 0.0, [k for k in range(2 * MASSES) if k not in MEASURED]
    for start in windows.starts:
        power, reached, rows, left = np.eye(2 * MASSES), windows.states[start].copy(), [], []
        for k in range(HORIZON):
            reached = step @ reached
            reached[MASSES] += STEP * windows.inputs[start + k, 0]
            power = step @ power
            rows.append(power[np.ix_(MEASURED, free)])
            left.append(windows.states[start + k + 1, list(MEASURED)] - reached[list(MEASURED)])
        rows, left = np.concatenate(rows), np.concatenate(left)
        best = np.linalg.lstsq(rows, left, rcond=1e-12)[0]
        total += np.sum((left - rows @ best) ** 2)
    return total


def problem():
    """Return objective and windows of states and forces that are noise."""
    random, samples = np.random.default_rng(3), COUNT + HORIZON
    states, u = random.normal(size=(samples, 2 * MASSES)), random.normal(size=(samples, 1))
    starts = np.arange(COUNT)
    windows = Windows(states, u, starts, 0 * starts, HORIZON, 1, STEP)
    predictor = Predictor(STEP, RungeKutta(EULER))
    return Objective(predictor, Chain(*RAW), np.ones(2 * MASSES), Loss()), windows


@pytest.mark.parametrize("by_column", [True, False])
def test_terms_are_those_of_linear_least_squares(monkeypatch, request, by_column):
    monkeypatch.setattr(free_starts, "_ACCEPTED", 0.0)  # start over where one step is not enough
    free = 2 * MASSES - len(MEASURED)
    assert free > free_starts._WRITTEN_OUT
    assert 2 * MASSES >= _MANY
    if not by_column:
        monkeypatch.setattr(Recursion, "_few_columns", lambda self, history: False)
        chunks._sum_over_chunks.clear_cache()
        request.addfinalizer(chunks._sum_over_chunks.clear_cache)
    objective, windows = problem()
    terms = objective.gauss_newton(RAW, windows)
    assert terms.loss * terms.count == pytest.approx(squares(RAW, windows), rel=1e-6)
    for k, step in enumerate(1e-4 * np.eye(2)):
        slope = (squares(RAW + step, windows) - squares(RAW - step, windows)) / 2e-4
        assert -2 * terms.descent[k] == pytest.approx(slope, rel=1e-4)


def test_one_step_finds_the_starts_of_a_linear_model():
    objective, windows = problem()
    error = objective.error
    with float64():
        values, horizon, one = on_device(RAW)[:, None], jnp.asarray(HORIZON), jnp.asarray(1)
        batch = compiled_windows(error, windows, COUNT)
        nowhere = jnp.zeros((len(error.free), len(batch.starts)), values.dtype)
        found, _ = free_starts._searched(error, values, horizon, batch, one, nowhere)
        nothing = NormalMatrix.zero(0, values)
        left = window_sums(error, values, found, horizon, batch, nothing).squares
        assert float(jnp.sum(left)) == pytest.approx(squares(RAW, windows), rel=1e-9)


def test_starts_are_solved_whatever_their_units():
    random, size, width = np.random.default_rng(5), 12, 3
    turn = np.linalg.qr(random.normal(size=(size, size)))[0]
    curvature = turn * 10.0 ** np.linspace(0, -9, size) @ turn.T
    scale = 10.0 ** random.uniform(-4, 4, size=size)
    curvature = scale[:, None] * curvature * scale
    right = curvature @ (random.normal(size=size) / scale)
    batched = np.repeat(curvature[..., None], width, axis=2)
    with float64():
        factor = free_starts._Factor.of(jnp.asarray(batched), jnp.zeros(width))
        step = factor.backward(factor.forward(jnp.asarray(right)[:, None, None] * np.ones(width)))
    gained = np.einsum("i,ib->b", right, np.asarray(step)[:, 0])
    np.testing.assert_allclose(gained, right @ np.linalg.solve(curvature, right), rtol=1e-9)
