"""Conventional methods that are plans of the engine."""

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous
from penode.errors import InputError
from penode.paper.conventional.trained_methods import CurrentPredictor, NeuralODE
from penode.pmsm.machine.dead_time import DeadTime
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER, RK4

pytestmark = pytest.mark.usefixtures("quickly_compiled")


def test_the_plans_are_those_of_the_papers():
    euler = CurrentPredictor().plan
    assert [stage.horizon for stage in euler.stages] == [1]
    assert euler.solver == RungeKutta(EULER)
    for horizon in (1, 2):
        plan = NeuralODE(horizon).plan
        assert [stage.horizon for stage in plan.stages] == [horizon]
        assert plan.solver == RungeKutta(RK4)
        assert isinstance(plan.placement, Contiguous)


@pytest.mark.slow
def test_the_current_predictor_takes_one_euler_step_with_dead_time(dead_time_run):
    run = Experiment("run", 1e-4, {n: v[:800] for n, v in dead_time_run.channels.items()})
    fit = CurrentPredictor(evaluations=3).identify([run])
    i_d, i_q, u_d, u_q, omega, theta = run.stack(
        ("i_d", "i_q", "u_d", "u_q", "omega_el", "theta_el")
    )[:-1].T
    (term,) = (one for one in fit.model.terms if isinstance(one, DeadTime))
    scale = float(term.dead_time_current)
    scale = np.hypot(scale / np.hypot(1.0, scale / (128 * term.narrowest)), term.narrowest)
    shapes = [
        dead_time_shape(i, t, scale) for i, t in zip(np.stack([i_d, i_q], 1), theta, strict=True)
    ]
    lost = fit.parameters["dead_time_voltage"].value * np.array(shapes).T
    psi_d, psi_q = fit.flux_map(i_d, i_q)
    resistance = fit.parameters["R"].value
    left = np.stack([u_d, u_q]) - lost - resistance * np.stack([i_d, i_q])
    left += omega * np.stack([psi_q, -psi_d])
    inductance = fit.differential_inductance(i_d, i_q).transpose(2, 0, 1)
    slope = np.linalg.solve(inductance, left.T[..., None])[..., 0]
    expected = np.stack([i_d, i_q], axis=1) + 1e-4 * slope
    np.testing.assert_allclose(fit.comparisons[0].one_step[1:], expected, atol=1e-8)
    assert fit.parameters["dead_time_voltage"].value > 1.0


def dead_time_shape(current, theta, scale):
    """Signs of three phase currents, in dq, by the definition of the transform."""
    angles = theta - np.array([0.0, 2.0, -2.0]) * np.pi / 3
    phases = current[0] * np.cos(angles) - current[1] * np.sin(angles)
    signs = np.tanh(phases / scale)
    return 2 / 3 * np.array([np.sum(signs * np.cos(angles)), -np.sum(signs * np.sin(angles))])


@pytest.mark.slow
def test_the_neural_ode_trains_at_its_horizon(fast_run):
    run = Experiment("run", 1e-4, {n: v[:3000] for n, v in fast_run.channels.items()})
    fit = NeuralODE(2, evaluations=12).identify([run])
    assert fit.horizon.selected == 2
    assert fit.horizon.verdict == "fixed"
    assert fit.parameters["R"].value == pytest.approx(0.01, abs=0.002)


def test_bad_input_is_told(unseen_run):
    blind = Experiment(
        "blind", 1e-4, {n: v for n, v in unseen_run.channels.items() if n != "theta_el"}
    )
    with pytest.raises(InputError, match="theta_el"):
        CurrentPredictor().identify([blind])
