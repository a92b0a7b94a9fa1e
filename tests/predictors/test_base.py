"""The predictor holds the input over the sample and applies the solver's formula to the model."""

import numpy as np
import pytest

from penode import Predictor
from penode.arrays import float64
from penode.models.parameters import with_batch_axis
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER, RK4


def test_rk4_is_the_default():
    assert Predictor(1e-4).solver == RungeKutta(RK4)


@pytest.mark.parametrize("solver", [EULER, RK4], ids=lambda s: s.name)
@pytest.mark.parametrize("name", ["duffing", "linear machine"])
def test_step_agrees_with_the_numpy_twin(systems, name, solver):
    system = systems[name]
    run = system.experiments[0]
    x, u = run.stack(system.model.states).T, run.stack(system.model.inputs).T
    with float64():
        predictor = Predictor(run.time_step, RungeKutta(solver))
        found = predictor.step(with_batch_axis(system.model), x[None], lambda offset: u)[0]
    expected = system.step(solver.name, system.raw[:, None], x, u)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
