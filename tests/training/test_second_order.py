"""Levenberg-Marquardt: where it ends, what it never does, and what it does not depend on."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from penode.training import second_order
from penode.training.gauss_newton_terms import GaussNewtonTerms
from penode.training.plan import DIVERGED, Problem
from penode.training.second_order import LevenbergMarquardt, _after, _reach

#: ln L_d, ln L_q, R, psi: 30 to 100 % off.
OFF = np.array([0.3, -0.4, 0.2, -0.03])


@pytest.fixture(scope="module")
def machine(systems):
    return systems["linear machine"]


@pytest.mark.parametrize("horizon", [1, 7, 23])
def test_parameters_of_its_own_noise_free_data_are_recovered(machine, problem_of, horizon):
    problem = problem_of(machine, horizon, experiments=machine.recorded_again())
    solution = LevenbergMarquardt().minimise(problem, machine.raw + OFF)
    found = problem.reported.values(solution.raw)
    np.testing.assert_allclose(found, [2e-3, 3e-3, 0.2, 0.05], rtol=1e-6)
    assert solution.terms.loss < 1e-18


def test_physical_parameters_beside_a_network_are_recovered(systems, problem_of, rng):
    system = systems["duffing"]
    problem = problem_of(system, 7, experiments=system.recorded_again())
    start = system.raw + 0.1 * rng.normal(size=len(system.raw))
    solution = LevenbergMarquardt(evaluations=300, tolerance=1e-9).minimise(problem, start)
    found = problem.reported.values(solution.raw)
    np.testing.assert_allclose(found[:2], [0.7, 0.3], rtol=1e-6)
    np.testing.assert_allclose(found, problem.reported.values(system.raw), rtol=0, atol=1e-4)


def test_minimum_is_that_of_scipy(machine, problem_of):
    """On noisy data, where the residuals stay large."""
    problem = problem_of(machine, 7, experiments=machine.recorded_again(noise=2.0))
    scale = np.array([1.0, 1.0, 0.1, 0.01])

    def residual(shift):
        raw = machine.raw + scale * shift
        return machine.sensitivities("rk4", raw, problem.windows)[0].ravel()

    def jacobian(shift):
        slope = machine.sensitivities("rk4", machine.raw + scale * shift, problem.windows)[1]
        return -np.moveaxis(slope, 2, -1).reshape(-1, 4) * scale

    expected = least_squares(residual, np.zeros(4), jac=jacobian, xtol=1e-14, ftol=1e-14)
    solution = LevenbergMarquardt(100, tolerance=1e-7).minimise(problem, machine.raw)
    assert solution.terms.loss * solution.terms.count == pytest.approx(2 * expected.cost, rel=1e-9)
    np.testing.assert_allclose((solution.raw - machine.raw) / scale, expected.x, rtol=1e-5)


def test_it_stops_when_reported_quantities_stand_still(machine, problem_of):
    """The remaining Gauss-Newton step is a small share of the deviations, found independently."""
    problem = problem_of(machine, 7, experiments=machine.recorded_again(noise=0.05))
    solution = LevenbergMarquardt().minimise(problem, machine.raw + OFF)
    assert solution.outcome == "Reported quantities have converged."
    assert solution.evaluations < 40
    further = LevenbergMarquardt(100, tolerance=1e-8).minimise(problem, solution.raw)
    moved = problem.reported.values(further.raw) - problem.reported.values(solution.raw)
    residual, slope = machine.sensitivities("rk4", further.raw, problem.windows)
    rows = np.moveaxis(slope, 2, -1).reshape(-1, 4)
    classical = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)) * np.mean(residual**2))
    classical *= [2e-3, 3e-3, 1.0, 1.0]
    assert (np.abs(moved) < 0.1 * classical).all()


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), spread=st.floats(0.0, 3.0), damping=st.floats(1e-12, 1e6))
def test_the_loss_never_rises(machine, problem_of, seed, spread, damping):
    problem = problem_of(machine, 7)
    off = spread * np.random.default_rng(seed).normal(size=4) * [1.0, 1.0, 1.0, 0.3]
    start, losses = machine.raw + off, []
    optimiser = LevenbergMarquardt(evaluations=10, damping=damping)
    solution = optimiser.minimise(problem, start, lambda raw, loss: losses.append(loss))
    if solution.outcome == DIVERGED:
        np.testing.assert_array_equal(solution.raw, start)
        return
    assert (np.diff(losses) <= 0).all()
    assert solution.terms.loss <= losses[0]
    assert problem.gauss_newton(solution.raw).loss == solution.terms.loss


def test_a_start_that_diverges_is_given_back(machine, problem_of):
    start = machine.raw - np.array([12.0, 12.0, 0.0, 0.0])  # L of 10 nH: R T / L is 1600
    solution = LevenbergMarquardt().minimise(problem_of(machine, 100), start)
    assert solution.outcome == DIVERGED
    np.testing.assert_array_equal(solution.raw, start)
    assert not solution.terms.finite


def test_one_evaluation_sees_a_divergence_too(machine, problem_of):
    start = machine.raw - np.array([12.0, 12.0, 0.0, 0.0])
    solution = LevenbergMarquardt(evaluations=1).minimise(problem_of(machine, 100), start)
    assert solution.outcome == DIVERGED


def test_frozen_parameters_stay_to_the_last_bit(machine, problem_of):
    problem = problem_of(machine, 7, groups=("physical",))
    start = machine.raw + OFF
    solution = LevenbergMarquardt().minimise(problem, start)
    assert solution.raw[3] == start[3]
    assert (solution.raw[:3] != start[:3]).all()


def test_evaluations_are_limited_and_counted(machine, problem_of):
    problem, calls = problem_of(machine, 7), []
    watched = Watched(**vars(problem), calls=calls)
    solution = LevenbergMarquardt(evaluations=3, tolerance=0.0).minimise(watched, machine.raw + OFF)
    assert (len(calls), solution.evaluations) == (3, 3)
    assert solution.outcome == "The evaluations are used up."


def test_at_the_minimum_no_step_lowers_the_loss(machine, problem_of):
    problem = problem_of(machine, 7, experiments=machine.recorded_again(noise=0.5))
    there = LevenbergMarquardt(100, tolerance=1e-9).minimise(problem, machine.raw).raw
    solution = LevenbergMarquardt(200, tolerance=0.0).minimise(problem, there)
    assert solution.outcome == "No step lowers the loss any more."
    np.testing.assert_allclose(solution.raw, there, rtol=1e-8)


@dataclass(frozen=True, eq=False)
class Watched(Problem):
    """A problem that remembers its evaluations."""

    calls: list

    def gauss_newton(self, raw):
        self.calls.append(raw)
        return super().gauss_newton(raw)


@dataclass(frozen=True, eq=False)
class InOtherUnits(Problem):
    """The same problem with raw parameters counted in units of `unit`."""

    unit: np.ndarray

    def gauss_newton(self, raw):
        terms = super().gauss_newton(raw * self.unit)
        return replace(
            terms,
            normal=terms.normal * np.outer(self.unit, self.unit),
            descent=terms.descent * self.unit,
            scores=terms.scores * self.unit[:, None],
        )

    def reported_jacobian(self, raw):
        return super().reported_jacobian(raw * self.unit) * self.unit


@pytest.mark.parametrize(
    "unit",
    [
        pytest.param([1, 1, 1e-3, 1], id="mohm"),
        pytest.param([1, 1, 1, 1e3], id="kVs"),
        pytest.param([1e-2, 50, 2e-3, 7e2], id="all"),
        pytest.param(
            [1, 1, 1, 1e12],
            id="pF beside ohm",
        ),
    ],
)
def test_the_path_does_not_depend_on_units(machine, problem_of, unit):
    problem, start, unit = problem_of(machine, 7), machine.raw + OFF, np.array(unit, dtype=float)
    paths = []
    for case, factor in ((problem, np.ones(4)), (InOtherUnits(**vars(problem), unit=unit), unit)):
        path = []
        LevenbergMarquardt().minimise(
            case, start / factor, lambda raw, loss, f=factor, p=path: p.append([*raw * f, loss])
        )
        paths.append(np.array(path))
    assert paths[0].shape == paths[1].shape
    assert len(paths[0]) > 4
    np.testing.assert_allclose(paths[1], paths[0], rtol=1e-8)


@pytest.mark.parametrize("curvature", [0.8, 1.0, 1.7, 4.0])
@pytest.mark.parametrize("reach", [1.0, 0.6, 0.3])
def test_a_step_ends_where_a_parabola_is_least(curvature, reach):
    """Of a loss that falls by 2 t - c t^2 that is 1/c of the step, twice what was taken at most."""
    gain = (2 * reach - curvature * reach**2) / (2 * reach - reach**2)
    assert _reach(reach, gain) == pytest.approx(min(1 / curvature, 2 * reach, 1.0))
    assert 0 < _reach(reach, -np.inf) < reach


class Unpenalised:
    """A problem of which nothing is reported, without penalties; subclasses give its terms."""

    windows = None
    objective = SimpleNamespace(layout=SimpleNamespace(physical=()))

    def penalties(self, raw):
        return np.empty(0), np.empty((0, len(raw)))

    def reported_jacobian(self, raw):
        return np.empty((0, len(raw)))

    def spread(self, step):
        return step


def test_a_kink_does_not_make_steps_go_to_and_fro():
    """A loss that bends more than Gauss and Newton see: r'r with r = (x, 10 + x^2 / 20)."""

    class Bent(Unpenalised):
        def gauss_newton(self, raw):
            residual = np.array([raw[0], 10 + raw[0] ** 2 / 20])
            slope = -np.array([[1.0], [raw[0] / 10]])
            normal, descent = slope.T @ slope, slope.T @ residual
            return GaussNewtonTerms(float(residual @ residual), 1, normal, descent, slope.T)

    solution = LevenbergMarquardt(8, damping=1e-9).minimise(Bent(), np.array([1.0]))
    assert solution.converged
    assert abs(solution.raw[0]) < 1e-4


def test_a_rejected_step_is_restrained_at_once():
    """Columns nearly alike: the full step goes far along what they differ by, where nothing is."""

    class Walled(Unpenalised):
        def gauss_newton(self, raw):
            slope = -np.array([[1.0, 1.0], [0.005, -0.005]])
            residual = np.array([2.0, 0.5]) + slope @ raw
            loss = float(residual @ residual) if abs(raw[0] - raw[1]) < 1 else np.inf
            return GaussNewtonTerms(loss, 1, slope.T @ slope, -slope.T @ residual, slope.T)

    solution = LevenbergMarquardt(3, damping=1e-9).minimise(Walled(), np.zeros(2))
    assert solution.terms.loss < 4.0  # 4.25 at the start


@pytest.mark.parametrize(("noise", "most"), [(1e-4, 15), (0.0, 3)])
def test_no_step_is_shortened_beyond_what_matters(noise, most):
    """A loss of 1 that jumps by a part of itself wherever it is looked at, and never falls."""

    class Jumping(Unpenalised):
        asked = 0

        def gauss_newton(self, raw):
            self.asked += 1
            slope = -np.array([[1.0]])
            loss = 1 + noise * self.asked + 0.5 * raw[0] ** 2
            return GaussNewtonTerms(loss, 1, np.eye(1), np.array([1e-2 - raw[0]]), slope.T)

    solution = LevenbergMarquardt(60, damping=1e-9).minimise(Jumping(), np.zeros(1))
    assert solution.evaluations <= most
    assert abs(solution.raw[0]) <= 0.011


@pytest.mark.parametrize(
    ("gain", "factor"), [(1e-9, 2.0), (0.5, 1.0), (1.0, 1 / 3), (1e3, 1 / 3), (1e200, 1 / 3)]
)
def test_damping_follows_the_gain_and_a_promise_of_nothing_does_no_harm(gain, factor):
    assert _after(gain) == pytest.approx(factor, abs=1e-6)


def test_a_step_beyond_any_number_of_deviations_has_not_converged(monkeypatch):
    monkeypatch.setattr(second_order, "sandwich_deviation", lambda *given: np.zeros(1))
    monkeypatch.setattr(second_order.ScoreSeries, "of_windows", lambda windows: None)
    problem = SimpleNamespace(
        reported_jacobian=lambda raw: np.array([[1e200]]),
        windows=None,
        objective=SimpleNamespace(layout=SimpleNamespace(physical=("a",))),
    )
    local = SimpleNamespace(
        problem=problem,
        raw=None,
        terms=SimpleNamespace(loss=1.0),
        step=lambda damping: np.ones(1),
        promised=lambda step: 0.0,
    )
    with np.errstate(all="raise"):
        assert not LevenbergMarquardt()._converged(local)
