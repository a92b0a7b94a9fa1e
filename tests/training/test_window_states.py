"""States of windows: against windows predicted one by one in NumPy."""

from typing import ClassVar

import numpy as np
import pytest

from penode import Contiguous, Experiment, Jittered, Model, Predictor, physical
from penode.data.windows import cut
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import EULER
from penode.training.loss import Loss
from penode.training.residuals import Objective
from penode.training.window_states import mean_states, start_states

STEP, RATE, PULL = 0.1, 0.7, 2.0


class Oscillator(Model):
    """y'' = -pull y - rate y', the position measured alone."""

    states: ClassVar[tuple[str, ...]] = ("y", "v")
    inputs: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s")
    unmeasured: ClassVar[tuple[str, ...]] = ("v",)

    rate: object = physical("1/s")

    def derivative(self, x, u):
        return np.array([[0.0, 1.0], [-PULL, 0.0]]) @ x - self.rate * x * np.array([[0.0], [1.0]])


def path(count):
    """Return Euler's path (time, state) in two sub-steps a sample."""
    x, rows = np.array([1.0, -0.3]), []
    for _ in range(count):
        rows.append(x)
        for _ in range(2):
            x = x + 0.5 * STEP * np.array([x[1], -PULL * x[0] - RATE * x[1]])
    return np.array(rows)


@pytest.fixture(scope="module")
def states():
    return path(400)


@pytest.mark.parametrize("guess", [False, True])
def test_a_right_model_gives_back_the_states_that_nobody_measured(states, guess):
    """More windows than a block has; samples that none passes are unknown."""
    channels = {"y": states[:, 0]} | (
        {"v": states[:, 1] + 0.1} if guess else {"v": 0 * states[:, 0]}
    )
    model = Oscillator(RATE)
    run = Experiment("run", STEP, channels)
    windows = cut([run], model.states, (), 8, placement=Jittered(0, fewest=300))
    predictor = Predictor(STEP, Substeps(RungeKutta(EULER), 2))
    objective = Objective(predictor, model, np.ones(2), Loss(), 1)
    raw = objective.layout.raw(model)
    starts = start_states(objective.error, raw, windows)
    np.testing.assert_allclose(starts, states[windows.starts], atol=1e-9)
    mean = mean_states(objective.error, raw, windows)
    passed = np.zeros(400, bool)
    for start in windows.starts:
        passed[start : start + 9] = True
    np.testing.assert_allclose(mean[passed], states[passed], atol=1e-9)
    assert np.isnan(mean[~passed]).all()


def test_each_sample_has_the_mean_of_what_its_windows_predict(states):
    """With a model that is wrong, so that windows differ where they meet."""
    model = Oscillator(0.0)
    run = Experiment("run", STEP, {"y": states[:, 0], "v": states[:, 1]})
    predictor = Predictor(STEP, Substeps(RungeKutta(EULER), 2))
    objective = Objective(predictor, model, np.ones(2), Loss(), 1)
    windows = cut([run], model.states, (), 8, placement=Contiguous())
    starts = start_states(objective.error, raw := objective.layout.raw(model), windows)
    total, count = np.zeros((400, 2)), np.zeros((400, 1))
    for at, x in zip(windows.starts, starts, strict=True):
        for k in range(9):
            total[at + k] += x
            count[at + k] += 1
            for _ in range(2):
                x = x + 0.5 * STEP * np.array([x[1], -PULL * x[0]])
    mean = mean_states(objective.error, raw, windows)
    seen = count[:, 0] > 0
    np.testing.assert_allclose(mean[seen], total[seen] / count[seen], rtol=1e-12, atol=1e-14)
    assert count.max() == 2
