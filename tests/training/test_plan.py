"""A problem shows an optimiser the moving parameters only."""

import numpy as np
import pytest

from penode import Contiguous, Jittered, Plan, Stage
from penode.training.plan import ignore_progress
from penode.training.second_order import LevenbergMarquardt


@pytest.mark.parametrize(
    ("groups", "moving"), [(None, [0, 1, 2, 3]), (("magnet",), [3]), (("physical",), [0, 1, 2])]
)
def test_terms_are_those_of_the_moving_parameters(systems, problem_of, groups, moving):
    system = systems["linear machine"]
    problem = problem_of(system, 7, groups=groups)
    residual, slope = system.sensitivities("rk4", system.raw, problem.windows)
    slope = slope[:, :, moving]
    terms = problem.gauss_newton(system.raw)
    np.testing.assert_allclose(terms.normal, np.einsum("kspw,ksqw->pq", slope, slope), rtol=1e-8)
    np.testing.assert_allclose(terms.scores, np.einsum("kspw,ksw->pw", slope, residual), rtol=1e-6)
    np.testing.assert_allclose(terms.descent, terms.scores.sum(axis=1), rtol=1e-9)
    assert terms.loss == pytest.approx(np.mean(residual**2), rel=1e-12)
    full = problem.reported.jacobian(system.raw)
    np.testing.assert_array_equal(problem.reported_jacobian(system.raw), full[:, moving])


def test_a_step_is_spread_over_the_moving_parameters(systems, problem_of):
    machine = systems["linear machine"]
    three, one = (problem_of(machine, 1, groups=(g,)) for g in ("physical", "magnet"))
    np.testing.assert_array_equal(three.spread(np.array([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0, 0.0])
    np.testing.assert_array_equal(one.spread(np.array([4.0])), [0.0, 0.0, 0.0, 4.0])


def test_windows_are_jittered_unless_asked_otherwise():
    stage = Stage(5, LevenbergMarquardt())
    assert stage.groups is None
    assert Plan((stage,)).placement == Jittered(0)
    assert Plan((stage,), Contiguous()).placement == Contiguous()
    assert ignore_progress(np.zeros(1), 0.0) is None
