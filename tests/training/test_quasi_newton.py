"""L-BFGS against the minimum that second-order training finds of the same problem."""

import numpy as np
import pytest

from penode.training.quasi_newton import quasi_newton
from penode.training.second_order import LevenbergMarquardt


@pytest.fixture(scope="module")
def machine(systems):
    return systems["linear machine"]


@pytest.fixture(scope="module")
def problem(machine, problem_of):
    return problem_of(machine, 7, experiments=machine.recorded_again(noise=0.05))


@pytest.mark.parametrize("groups", [None, ("physical",)])
def test_it_ends_in_the_minimum_whatever_the_units(machine, problem_of, problem, groups):
    if groups:
        problem = problem_of(machine, 7, experiments=machine.recorded_again(0.05), groups=groups)
    raw = 1.2 * machine.raw  # inductances of mH beside a resistance of 0.2 ohm
    least = LevenbergMarquardt(tolerance=1e-6).minimise(problem, raw)
    seen = []
    found = quasi_newton(problem, raw, 200, lambda at, loss: seen.append((at, loss)))
    np.testing.assert_allclose(found[problem.moving], least.raw[problem.moving], rtol=1e-4)
    np.testing.assert_array_equal(found[~problem.moving], raw[~problem.moving])
    losses = [loss for _, loss in seen]
    assert losses == sorted(losses, reverse=True)
    np.testing.assert_array_equal(seen[-1][0], found)
    assert losses[-1] == pytest.approx(least.terms.loss, rel=1e-8)


def test_iterations_are_no_more_than_allowed(machine, problem):
    seen = []
    quasi_newton(problem, 1.2 * machine.raw, 3, lambda *at: seen.append(at))
    assert len(seen) == 3


def test_it_turns_back_from_predictions_that_diverge(machine, problem, monkeypatch):
    """Beyond a bound no loss is known; the minimum is within it."""
    raw, known = 1.2 * machine.raw, problem.objective.loss_and_gradient

    def bounded(at, windows):
        loss, slope = known(at, windows)
        return (loss, slope) if np.all(np.abs(at / raw - 1) < 0.3) else (np.nan, np.nan * slope)

    monkeypatch.setattr(problem.objective, "loss_and_gradient", bounded)
    found = quasi_newton(problem, raw, 200)
    assert np.all(np.abs(found / raw - 1) < 0.3)
    assert known(found, problem.windows)[0] < 0.1 * known(raw, problem.windows)[0]
