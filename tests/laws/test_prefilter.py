"""k-step training is one-step training with a filter: eps_(t+k|t) = sum_j A^(k-1-j) e_(t+j)."""

import numpy as np
import pytest

from penode import Experiment, Predictor
from penode.validation.free_run import compare

SPEED = 150.0


@pytest.fixture(scope="module")
def case(systems):
    """Return the linear machine, its recordings at constant speed, and its one-step matrix A."""
    system = systems["linear machine"]
    runs = tuple(
        Experiment(r.name, r.time_step, {**r.channels, "omega_el": np.full(len(r), SPEED)})
        for r in system.experiments
    )
    model = system.model
    rate = np.array(
        [
            [-model.R / model.L_d, SPEED * model.L_q / model.L_d],
            [-SPEED * model.L_d / model.L_q, -model.R / model.L_q],
        ]
    )
    # RK4 on a linear system is the exponential series to the fourth power.
    z = rate * system.time_step
    matrix = np.eye(2) + z @ (np.eye(2) + z @ (np.eye(2) + z @ (np.eye(2) + z / 4) / 3) / 2)
    return system, runs, matrix


def test_free_run_error_is_the_filtered_one_step_error(case):
    system, runs, matrix = case
    found = compare(Predictor(system.time_step), system.model, runs[0], "train")
    one_step = (found.measured - found.one_step)[1:]
    filtered, expected = np.zeros(2), []
    for error in one_step:
        filtered = matrix @ filtered + error
        expected.append(filtered)
    free = (found.measured - found.free_run)[1:]
    assert np.abs(free).max() > 5 * np.abs(one_step).max()
    np.testing.assert_allclose(free, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("horizon", [1, 7, 23])
def test_training_loss_is_that_of_the_filtered_one_step_errors(case, objective_of, horizon):
    system, runs, matrix = case
    predictor = Predictor(system.time_step)
    errors = []
    for run in runs:
        comparison = compare(predictor, system.model, run, "train")
        # Row t + 1 belongs to the step from t; a last row fills the place of the next recording.
        errors.append(np.roll(comparison.measured - comparison.one_step, -1, axis=0))
    errors = np.concatenate(errors)
    windows = system.windows(horizon, runs)
    total = 0.0
    for start in windows.starts:
        filtered = np.zeros(2)
        for error in errors[start : start + horizon]:
            filtered = matrix @ filtered + error
            total += filtered @ filtered
    terms = objective_of(system).gauss_newton(system.raw, windows)
    assert terms.loss == pytest.approx(total / terms.count, rel=1e-10)
