"""Starts trained side by side end where each would end alone."""

from dataclasses import replace

import numpy as np
import optax
import pytest

from penode import Plan, Stage, identify
from penode.errors import InputError
from penode.horizon.parallel_starts import sweep
from penode.horizon.selection import Longest
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.first_order import FirstOrder
from penode.training.second_order import LevenbergMarquardt

pytestmark = pytest.mark.usefixtures("quickly_compiled")


def plan_of(horizon, seed=0):
    optimiser = FirstOrder(optax.adam(1e-2), epochs=2, batches=4, seed=seed)
    return Plan((Stage(1, optimiser), Stage(horizon, optimiser)))


@pytest.mark.slow
def test_a_sweep_is_its_fits_one_by_one(systems):
    system = systems["linear machine"]
    runs = system.recorded_again(noise=0.05)
    starts = [replace(system.model, R=np.array(r)) for r in (0.15, 0.25)]
    found = sweep(starts, runs, [plan_of(5), plan_of(9)])
    assert found.names == ("L_d", "L_q", "R", "psi")
    assert found.values.shape == (2, 2, 4)
    # Each start and each plan once, not as in a table on its diagonal: exchanged axes would show.
    for p, k, horizon in ((0, 1, 5), (1, 0, 9)):
        fit = identify(starts[k], runs, plan=plan_of(horizon, seed=k), purpose=Longest())
        alone = [fit.parameters[name].value for name in found.names]
        np.testing.assert_allclose(found.values[p, k], alone, rtol=1e-10)
        assert found.loss[p, k] == pytest.approx(fit.horizon.ladder[-1].rmse ** 2)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_diverged_start_has_no_loss(systems):
    system = systems["linear machine"]
    lost = replace(system.model, R=np.array(-1e9))
    found = sweep([system.model, lost], system.experiments, [plan_of(9)])
    assert np.isfinite(found.loss[0, 0])
    assert np.isnan(found.loss[0, 1])


def test_another_optimiser_is_refused(systems):
    system = systems["linear machine"]
    plan = Plan((Stage(1, LevenbergMarquardt()),))
    with pytest.raises(InputError, match="LevenbergMarquardt"):
        sweep([system.model], system.experiments, [plan])


def test_plans_of_two_solvers_are_refused(systems):
    system = systems["linear machine"]
    other = replace(plan_of(5), solver=RungeKutta(EULER))
    with pytest.raises(InputError, match="must share solver, hold and loss"):
        sweep([system.model], system.experiments, [plan_of(5), other])
