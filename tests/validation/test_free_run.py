"""One-step predictions and free runs against a NumPy loop."""

from dataclasses import replace

import numpy as np
import pytest

from penode import Experiment, InputError, Predictor
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.validation.free_run import Comparison, compare, free_run_rmse


def predictor_of(system):
    return Predictor(system.time_step)


@pytest.mark.parametrize("name", ["duffing", "linear machine"])
def test_predictions_are_those_of_the_numpy_twin(systems, name):
    system = systems[name]
    run = system.experiments[1]
    found = compare(predictor_of(system), system.model, run, "validation")
    measured, inputs = run.stack(system.model.states), run.stack(system.model.inputs)
    ahead = system.step("rk4", system.raw[:, None], measured[:-1].T, inputs[:-1].T).T
    free = system.simulate(measured[0], inputs)
    np.testing.assert_array_equal(found.measured, measured)
    np.testing.assert_array_equal(found.one_step[0], measured[0])
    np.testing.assert_allclose(found.one_step[1:], ahead, rtol=0, atol=1e-12 * np.abs(ahead).max())
    np.testing.assert_allclose(found.free_run, free, rtol=0, atol=1e-12 * np.abs(free).max())
    assert found.one_step_rmse == pytest.approx(np.sqrt(np.mean((ahead - measured[1:]) ** 2)))
    assert found.free_run_rmse == pytest.approx(np.sqrt(np.mean((free - measured)[1:] ** 2)))
    assert (found.name, found.role, found.time_step) == (run.name, "validation", run.time_step)
    assert (found.states, found.units) == (system.model.states, system.model.state_units)


def test_the_solver_is_the_predictors(systems):
    system = systems["duffing"]
    run = system.experiments[1]
    found = compare(Predictor(system.time_step, RungeKutta(EULER)), system.model, run, "train")
    measured, inputs = run.stack(system.model.states), run.stack(system.model.inputs)
    ahead = system.step("euler", system.raw[:, None], measured[:-1].T, inputs[:-1].T).T
    np.testing.assert_allclose(found.one_step[1:], ahead, rtol=0, atol=1e-12)


def test_a_free_run_that_diverges_has_an_infinite_error(systems):
    system = systems["linear machine"]
    unstable = replace(system.model, R=np.array(-200.0))
    run = system.experiments[1]
    found = compare(predictor_of(system), unstable, run, "train")
    assert found.free_run_rmse == np.inf
    assert np.isfinite(found.one_step_rmse)
    both = free_run_rmse(predictor_of(system), unstable, [run, run])
    assert both == np.inf


def test_free_run_error_weighs_recordings_by_their_length(systems):
    system = systems["linear machine"]
    runs = system.experiments
    parts = [compare(predictor_of(system), system.model, run, "train") for run in runs]
    errors = np.concatenate([(p.measured - p.free_run)[1:] for p in parts])
    found = free_run_rmse(predictor_of(system), system.model, runs)
    assert found == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-12)


def test_a_missing_channel_is_named(systems):
    system = systems["linear machine"]
    run = Experiment("half.csv", 1e-4, {"i_d": np.zeros(9), "i_q": np.zeros(9), "u_d": np.zeros(9)})
    with pytest.raises(InputError, match=r"half\.csv: no channel u_q, omega_el"):
        compare(predictor_of(system), system.model, run, "train")


def test_errors_leave_the_measured_start_out():
    zeros = np.zeros((3, 1))
    wrong_start = np.array([[9.0], [2.0], [2.0]])
    found = Comparison("run", "train", 1.0, ("x",), ("m",), zeros, wrong_start, wrong_start)
    assert (found.one_step_rmse, found.free_run_rmse) == (2.0, 2.0)
