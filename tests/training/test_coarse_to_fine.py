"""Few windows first: the same minimum, with most evaluations on a part of the windows."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from penode.training.coarse_to_fine import CoarseToFine
from penode.training.plan import DIVERGED, Solution, ignore_progress
from penode.training.second_order import LevenbergMarquardt

OFF = np.array([0.0, 0.0, 0.0, -0.03])


@dataclass(eq=False)
class Scripted:
    """An optimiser that adds one to the raw vector, and keeps what it was given."""

    outcome: str = "As told."
    calls: list = field(default_factory=list)

    def minimise(self, problem, raw, progress=ignore_progress):
        self.calls.append((problem.windows, raw))
        return Solution(raw + 1, problem.gauss_newton(raw), 9, self.outcome)


@pytest.fixture
def problem(systems, problem_of):
    """A problem of two states in which the magnet's flux linkage alone moves."""
    machine = systems["linear machine"]
    again = machine.recorded_again(noise=2.0)
    return problem_of(machine, 2, experiments=again, groups=("magnet",))


def test_minimum_is_that_of_all_windows(problem, systems):
    raw = systems["linear machine"].raw + OFF
    plain = LevenbergMarquardt(100, tolerance=1e-7)
    wanted, found = plain.minimise(problem, raw), CoarseToFine(plain).minimise(problem, raw)
    assert found.terms.loss == pytest.approx(wanted.terms.loss, rel=1e-10)
    values = problem.reported.values
    np.testing.assert_allclose(values(found.raw), values(wanted.raw), rtol=1e-5)


def test_every_nth_window_comes_first_and_counts_by_its_share(problem, systems):
    optimiser, raw = Scripted(), systems["linear machine"].raw
    found = CoarseToFine(optimiser, most=2).minimise(problem, raw)
    (few, begin), (all_of_them, after) = optimiser.calls
    np.testing.assert_array_equal(few.starts, problem.windows.starts[::2])
    np.testing.assert_array_equal(few.recording, problem.windows.recording[::2])
    assert all_of_them is problem.windows
    np.testing.assert_array_equal(begin, raw)
    np.testing.assert_array_equal(after, raw + 1)
    np.testing.assert_array_equal(found.raw, raw + 2)
    assert found.evaluations == 9 + 5


def test_150_residuals_a_parameter_are_left(problem, systems):
    optimiser = Scripted()
    CoarseToFine(optimiser, most=10_000).minimise(problem, systems["linear machine"].raw)
    few = len(optimiser.calls[0][0])
    assert 150 <= 2 * 2 * few < 2 * 150


def test_where_they_are_few_all_windows_are_taken_at_once(problem, systems):
    optimiser, windows = Scripted(), problem.windows
    short = replace(windows, starts=windows.starts[:40], recording=windows.recording[:40])
    one = replace(problem, windows=short)
    CoarseToFine(optimiser).minimise(one, systems["linear machine"].raw)
    assert [len(windows) for windows, _ in optimiser.calls] == [40]


def test_a_first_run_that_diverges_is_forgotten(problem, systems):
    optimiser, raw = Scripted(DIVERGED), systems["linear machine"].raw
    CoarseToFine(optimiser).minimise(problem, raw)
    np.testing.assert_array_equal(optimiser.calls[-1][1], raw)
