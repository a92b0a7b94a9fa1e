"""Adam against a loop written by hand on gradients by complex steps."""

from dataclasses import replace

import numpy as np
import optax
import pytest

from penode.training.first_order import FirstOrder
from penode.training.plan import DIVERGED

RATE = 1e-2
# One object each: programs are compiled for it.
ADAM, TOO_FAR = optax.adam(RATE), optax.sgd(1e6)


@pytest.fixture(scope="module")
def machine(systems):
    return systems["linear machine"]


@pytest.fixture(scope="module")
def problem(machine, problem_of):
    """Return a problem of 50 windows: batches of one size, so that one program serves them all."""
    return first_windows(problem_of(machine, 7, experiments=machine.recorded_again(noise=0.05)), 50)


def first_windows(problem, count):
    windows = problem.windows
    part = replace(windows, starts=windows.starts[:count], recording=windows.recording[:count])
    return replace(problem, windows=part)


def hand_run(machine, problem, raw, optimiser):
    """Run Adam (Kingma and Ba 2015, algorithm 1) with the batches of one permutation an epoch."""
    random = np.random.default_rng(optimiser.seed)
    first, second, count, losses = 0.0, 0.0, 0, []
    # The magnet is in a group of its own and therefore moves at the common rate.
    scale = np.array([optimiser.physical_scale] * 3 + [1.0])
    for _ in range(optimiser.epochs):
        order = random.permutation(len(problem.windows))
        for batch in np.array_split(order, optimiser.batches):
            part = replace(
                problem.windows,
                starts=problem.windows.starts[batch],
                recording=problem.windows.recording[batch],
            )
            residual, slope = machine.sensitivities("rk4", raw, part)
            gradient = -2 * np.einsum("ksw,kspw->p", residual, slope) / residual.size * scale
            losses.append(np.mean(residual**2))
            count += 1
            first = 0.9 * first + 0.1 * gradient
            second = 0.999 * second + 0.001 * gradient**2
            mean, square = first / (1 - 0.9**count), second / (1 - 0.999**count)
            raw = raw - RATE * mean / (np.sqrt(square) + 1e-8) * scale * problem.moving
    return raw, losses


@pytest.mark.parametrize("groups", [None, ("physical",)])
def test_adam_is_the_hand_run_loop(machine, problem, groups):
    problem = replace(problem, moving=problem.objective.layout.members(groups))
    optimiser = FirstOrder(ADAM, epochs=4, batches=5, seed=3, physical_scale=0.5)
    start, seen = machine.raw + 0.1, []
    solution = optimiser.minimise(problem, start, lambda raw, loss: seen.append((raw, loss)))
    expected, losses = hand_run(machine, problem, start, optimiser)
    np.testing.assert_allclose(solution.raw, expected, rtol=1e-10)
    np.testing.assert_array_equal(solution.raw != start, problem.moving)
    np.testing.assert_allclose([loss for _, loss in seen], losses[4::5], rtol=1e-10)
    assert solution.evaluations == 4
    assert solution.terms.loss == problem.gauss_newton(solution.raw).loss


def test_the_loss_falls_and_the_seed_alone_decides(machine, problem):
    optimiser = FirstOrder(ADAM, epochs=30, batches=5, seed=1)
    start = machine.raw + 0.2
    first, again, other = (
        o.minimise(problem, start) for o in (optimiser, optimiser, replace(optimiser, seed=2))
    )
    assert first.terms.loss < 0.3 * problem.gauss_newton(start).loss
    np.testing.assert_array_equal(first.raw, again.raw)
    assert not np.array_equal(first.raw, other.raw)


def test_more_batches_than_windows_are_one_each(machine, problem):
    few = first_windows(problem, 3)
    solution = FirstOrder(ADAM, epochs=2, batches=20).minimise(few, machine.raw)
    expected, _ = hand_run(machine, few, machine.raw, FirstOrder(epochs=2, batches=3))
    np.testing.assert_allclose(solution.raw, expected, rtol=1e-10)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_start_that_diverges_is_given_back(machine, problem):
    start = machine.raw - np.array([30.0, 30.0, 0.0, 0.0])
    solution = FirstOrder(epochs=3, batches=5).minimise(problem, start)
    assert solution.outcome == DIVERGED
    np.testing.assert_array_equal(solution.raw, start)


def test_a_step_into_divergence_gives_back_the_parameters_before_it(machine, problem):
    solution = FirstOrder(TOO_FAR, epochs=2, batches=5).minimise(problem, machine.raw)
    assert solution.outcome == DIVERGED
    assert solution.evaluations < 2
    assert solution.terms.finite


def test_a_last_step_into_divergence_is_told(machine, problem):
    few = first_windows(problem, 10)
    solution = FirstOrder(TOO_FAR, epochs=1, batches=1).minimise(few, machine.raw)
    assert solution.outcome == DIVERGED


def test_starts_side_by_side_are_what_each_is_alone(machine, problem):
    optimiser = FirstOrder(ADAM, epochs=3, batches=5, seed=4)
    raws = machine.raw + np.array([[0.1], [-30.0], [0.05]])
    together = optimiser.minimise_together(problem, raws)
    for k, (found, raw) in enumerate(zip(together, raws, strict=True)):
        alone = replace(optimiser, seed=4 + k).minimise(problem, raw)
        np.testing.assert_allclose(found.raw, alone.raw, rtol=1e-12)
        assert (found.evaluations, found.outcome) == (alone.evaluations, alone.outcome)
    assert [found.outcome == DIVERGED for found in together] == [False, True, False]
