"""Starts that windows estimate: against SciPy, a Schur complement written out, and differences.

The position of an oscillator is recorded and its speed is not. The twin is differentiated by
complex steps, with respect to the parameters and to each window's start.
"""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from penode import Experiment, InputError, Model, Predictor, identify, ladder_plan, physical
from penode.arrays import Leaf, float64
from penode.data.windows import Windows
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.uncertainty_budget import Imperfection, raw_shifts
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import AB2, EULER
from penode.training import free_starts
from penode.training.chunks import CHUNK, _sum_over_chunks
from penode.training.covariance import Reported
from penode.training.free_starts import estimated_starts
from penode.training.loss import DEFAULT_LOSS, Loss, equation
from penode.training.plan import Problem
from penode.training.prediction_error import Batch
from penode.training.residuals import Objective

pytestmark = pytest.mark.usefixtures("quickly_compiled")

STEP, HORIZON, WINDOWS = 0.1, 6, CHUNK + 9
SCALE = np.array([0.5, 1.0])
RAW = np.array([1.7, 0.3])


class Oscillator(Model):
    """x'' = u - k (x + x^3) - c x', x measured."""

    states: ClassVar[tuple[str, ...]] = ("x", "v")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s")
    unmeasured: ClassVar[tuple[str, ...]] = ("v",)

    k: Leaf = physical("1/s2")
    c: Leaf = physical("1/s")

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0] - self.k * (x[0] + x[0] ** 3) - self.c * x[1]])


def slope(raw, x, u):
    return np.stack([x[1] + 0 * raw[0], u - raw[0] * (x[0] + x[0] ** 3) - raw[1] * x[1]])


@pytest.fixture(scope="module")
def windows():
    """Return windows from every sample; the channel of the speed is a poor guess."""
    random, samples = np.random.default_rng(6), WINDOWS + HORIZON
    time = STEP * np.arange(samples)
    x = np.sin(1.3 * time) + 0.05 * random.normal(size=samples)
    v = np.cos(1.3 * time) + 0.4 * random.normal(size=samples)
    starts = np.arange(WINDOWS)
    u = random.normal(size=(samples, 1))
    return Windows(np.stack([x, v], axis=1), u, starts, 0 * starts, HORIZON, 1, STEP)


#: What the loss frees, and the deviation of each correction in the twin's order (x, v).
CASES = {
    "the unmeasured speed": ({}, (None, np.inf)),
    "the speed near its guess": ({"v": 0.3}, (None, 0.3)),
    "the measured position too": ({"x": 0.08}, (0.08, np.inf)),
}


class Case:
    """One loss, its objective, and the joint residual of the twin."""

    def __init__(self, name, windows):
        freed, deviations = CASES[name]
        self.windows = windows
        self.deviations = np.array([d for d in deviations if d is not None])
        self.free = [k for k, d in enumerate(deviations) if d is not None]
        predictor, model = Predictor(STEP, RungeKutta(EULER)), Oscillator(*RAW)
        self.objective = Objective(predictor, model, SCALE, Loss(free_starts=freed))

    def residual(self, raw, correction, windows):
        """Return scaled errors of the position, then of the corrections: (residual, window)."""
        first = windows.states.T[:, windows.starts]
        x = [first[0] + 0 * raw[0], first[1] + 0 * raw[0]]
        for row, change in zip(self.free, correction, strict=True):
            x[row] = x[row] + change
        x, rows = np.stack(np.broadcast_arrays(*x)), []
        for k in range(HORIZON):
            x = x + STEP * slope(raw, x, windows.inputs[windows.starts + k, 0])
            rows.append((windows.states[windows.starts + k + 1, 0] - x[0]) / SCALE[0])
        held = [c / d + 0 * rows[0] for c, d in zip(correction, self.deviations, strict=True)]
        return np.array([*rows, *held])

    def jacobian(self, raw, correction, windows):
        """Return J, (residual, window, column), the columns being raw and correction."""
        both, columns = np.concatenate([np.tile(raw[:, None], len(windows)), correction]), []
        for k in range(len(both)):
            moved = both + 1e-30j * np.eye(len(both))[:, [k]]
            columns.append(self.residual(moved[:2], moved[2:], windows).imag / 1e-30)
        return np.stack(columns, axis=-1)

    def starts(self, raw, windows):
        """Return each window's best correction by SciPy."""
        found = []
        for start in windows.starts:
            one = part_of(windows, [start])
            solution = least_squares(
                lambda c, one=one: self.residual(raw[:, None], c[:, None], one)[:, 0],
                np.zeros(len(self.free)),
                jac=lambda c, one=one: self.jacobian(raw, c[:, None], one)[:, 0, 2:],
                method="lm",
                xtol=1e-15,
                ftol=1e-15,
                gtol=1e-15,
            )
            found.append(solution.x)
        return np.array(found).T


def part_of(windows, starts):
    states, inputs, horizon = windows.states, windows.inputs, windows.horizon
    return Windows(states, inputs, starts, np.zeros(len(starts)), horizon, 1, STEP)


#: Both kinds of prior at once in the last one.
REPEATING = pytest.param("the speed near its guess", marks=pytest.mark.slow)


@pytest.fixture(scope="module", params=["the unmeasured speed", REPEATING, list(CASES)[-1]])
def case(request, windows):
    return Case(request.param, windows)


@pytest.fixture
def exact(monkeypatch):
    """Start over wherever one step is not enough to rounding."""
    monkeypatch.setattr(free_starts, "_ACCEPTED", 0.0)
    _sum_over_chunks.clear_cache()
    yield
    monkeypatch.undo()
    _sum_over_chunks.clear_cache()


def test_estimated_starts_are_those_of_scipy(case, windows):
    few = part_of(windows, np.arange(0, WINDOWS, 12))
    with float64():
        values, none = jnp.asarray(RAW[:, None]), np.empty((0, WINDOWS + HORIZON))
        parts = (few.states.T, few.inputs.T, few.starts, few.recording, np.ones(len(few)), 1, none)
        batch = Batch(*(jnp.asarray(part) for part in (*parts, few.begins)))
        found = estimated_starts(case.objective.error, values, jnp.asarray(HORIZON), batch)
    expected = case.starts(RAW, few)
    assert np.abs(expected).max() > 0.05
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.usefixtures("exact")
def test_terms_are_the_schur_complement_of_the_joint_ones(case, windows):
    for count in (WINDOWS, CHUNK, 5):
        compare_with_joint_terms(case, part_of(windows, np.arange(count)))


def compare_with_joint_terms(case, part):
    count = len(part.starts)
    correction = case.starts(RAW, part)
    residual = case.residual(RAW[:, None], correction, part)
    jacobian = case.jacobian(RAW, correction, part)
    normal, descent = np.zeros((2, 2)), np.zeros((2, count))
    for w in range(count):
        shared, own = jacobian[:, w, :2], jacobian[:, w, 2:]
        joint, mixed = own.T @ own, own.T @ shared
        normal += shared.T @ shared - mixed.T @ np.linalg.solve(joint, mixed)
        reduced = shared.T - mixed.T @ np.linalg.solve(joint, own.T)
        descent[:, w] = -reduced @ residual[:, w]
    terms = case.objective.gauss_newton(RAW, part)
    assert terms.count == count * HORIZON
    assert terms.loss == pytest.approx(np.sum(residual**2) / terms.count, rel=1e-9)
    np.testing.assert_allclose(terms.normal, normal, rtol=0, atol=1e-6 * np.abs(normal).max())
    size = np.abs(descent).max()
    np.testing.assert_allclose(terms.scores, descent, rtol=0, atol=1e-6 * size)
    np.testing.assert_allclose(terms.descent, descent.sum(axis=1), rtol=0, atol=1e-6 * size)


@pytest.mark.usefixtures("exact")
def test_starts_of_near_by_parameters_lead_to_the_same_terms(case, windows):
    near = case.objective.gauss_newton(1.05 * RAW, windows)
    plain, led = (case.objective.gauss_newton(RAW, windows, s) for s in (None, near.starts))
    assert near.far
    assert led.far
    assert led.loss == pytest.approx(plain.loss, rel=1e-9)
    size = np.abs(plain.scores).max()
    np.testing.assert_allclose(led.scores, plain.scores, rtol=0, atol=1e-6 * size)
    np.testing.assert_allclose(led.starts, plain.starts, rtol=0, atol=1e-6)
    one = case.objective.descent(RAW, windows, near.starts)
    np.testing.assert_allclose(one, led.descent, rtol=0, atol=1e-9 * size)


def test_starts_one_step_away_are_not_far(case, windows, monkeypatch):
    """They are looked for from zero each time, so that what is changed changes nothing else."""
    monkeypatch.setattr(free_starts, "_ACCEPTED", 1e30)
    _sum_over_chunks.clear_cache()
    plain = case.objective.gauss_newton(RAW, windows)
    assert not plain.far
    assert case.objective.gauss_newton(RAW, windows, plain.starts).far  # and so are those after it
    _sum_over_chunks.clear_cache()


def test_a_problem_leads_with_the_starts_of_the_better_terms(case, windows):
    given = []

    class Listening:
        layout, penalties = case.objective.layout, case.objective.penalties

        def gauss_newton(self, raw, windows, starts=None):
            given.append(starts)
            return replace(case.objective.gauss_newton(raw, windows, starts), far=far)

    for far in (True, False):
        given.clear()
        moving = np.ones(2, bool)
        problem = Problem(
            Listening(), Reported(case.objective.layout, np.zeros((1, 2))), windows, moving
        )
        first, second = (problem.gauss_newton(raw) for raw in (RAW, 1.2 * RAW))
        problem.gauss_newton(0.9 * RAW)
        best = min((first, second), key=lambda terms: terms.loss)
        assert given[0] is None
        assert given[1] is (first.starts if far else None)
        assert given[2] is (best.starts if far else None)


def test_one_step_is_enough_where_squares_are_right_to_a_millionth(case, windows):
    """Slopes are then right to its root."""
    correction = case.starts(RAW, windows)
    squares = np.sum(case.residual(RAW[:, None], correction, windows) ** 2)
    terms = case.objective.gauss_newton(RAW, windows)
    gradient = case.objective.loss_and_gradient(RAW, windows)[1]
    assert terms.loss * terms.count == pytest.approx(squares, rel=1e-6)
    slopes, size = terms.count * gradient, np.abs(terms.scores).sum(axis=1).max()
    np.testing.assert_allclose(-2 * terms.descent, slopes, rtol=0, atol=1e-3 * size)


@pytest.mark.usefixtures("exact")
def test_gradient_is_that_of_the_loss_with_the_starts_estimated_again(case, windows):
    loss, gradient = case.objective.loss_and_gradient(RAW, windows)
    terms = case.objective.gauss_newton(RAW, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-10)
    np.testing.assert_allclose(gradient, -2 * terms.descent / terms.count, rtol=1e-6)
    for k, step in enumerate(1e-4 * np.eye(2)):
        ahead, behind = (case.objective.gauss_newton(RAW + s * step, windows) for s in (1, -1))
        assert (ahead.loss - behind.loss) / 2e-4 == pytest.approx(gradient[k], rel=1e-5)


# --- a whole identification -------------------------------------------------------------------


def positions(samples=500, noise=2e-3):
    """Record the position of the twin, integrated four times as finely."""
    random, state = np.random.default_rng(4), np.array([0.5, -1.0])
    time = STEP * np.arange(samples)
    u = 1.5 * np.sin(1.1 * time) + np.sin(2.7 * time + 1.0)
    path = [state]
    for push in u[:-1]:
        for _ in range(4):
            h = STEP / 4
            k1 = slope(RAW, state, push)
            k2 = slope(RAW, state + h / 2 * k1, push)
            k3 = slope(RAW, state + h / 2 * k2, push)
            k4 = slope(RAW, state + h * k3, push)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        path.append(state)
    path = np.array(path)
    return Experiment(
        "x.csv", STEP, {"x": path[:, 0] + noise * random.normal(size=samples), "u": u}
    )


@pytest.fixture(scope="module")
def fit():
    return identify(Oscillator(1.0, 0.0), [positions()], plan=ladder_plan((6, 12, 24)))


@pytest.mark.parametrize(("name", "truth"), [("k", 1.7), ("c", 0.3)])
def test_parameters_are_found_from_the_position_alone(fit, name, truth):
    low, high = fit.parameters[name].interval_95
    assert low < truth < high
    assert high - low < 0.05


def test_only_the_measured_state_is_compared(fit):
    (comparison,) = fit.comparisons
    assert comparison.states == ("x",)
    assert comparison.units == ("m",)
    assert 1.8e-3 < comparison.free_run_rmse < 4e-3  # 2 mm of noise, and the start's own


def test_what_changes_nothing_moves_no_parameter(monkeypatch):
    """Descents are compared after a step of 1e-5: a start searched elsewhere would be seen."""
    plan = ladder_plan((6, 12))
    problem = LadderProblem.of(Oscillator(1.0, 0.0), [positions()], plan, ignore_events)
    rung = problem.climb(plan, problem.objective.layout.raw(problem.model)).fits[-1]
    assert np.abs(rung.solution.terms.starts).max() > 0.0
    assert rung.solution.terms.far
    nothing = Imperfection("nothing", "", "", lambda experiment, deviations: experiment)
    descent, begun = Objective.descent, []

    def listening(objective, raw, windows, starts=None):
        begun.append(starts)
        return descent(objective, raw, windows, starts)

    monkeypatch.setattr(Objective, "descent", listening)
    moved = raw_shifts(problem, plan, plan.stages[-1], rung, [nothing])
    assert [starts is rung.solution.terms.starts for starts in begun] == [True, True]
    np.testing.assert_array_equal(moved, np.zeros((1, 2)))


# --- refusals ---------------------------------------------------------------------------------


EULERS = RungeKutta(EULER)


def refused(words, solver=EULERS, loss=DEFAULT_LOSS):
    with pytest.raises(InputError, match=words) as caught:
        Objective(Predictor(STEP, solver), Oscillator(*RAW), SCALE, loss)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_a_multistep_solver_has_no_past_for_an_unmeasured_state():
    refused(r"starts of v are to be estimated, but .* starts from 2 samples", AdamsBashforth(AB2))


def test_a_free_start_of_a_state_the_model_lacks():
    refused(
        "free_starts must name states, got w; the states are x, v",
        loss=Loss(free_starts={"w": 1.0}),
    )


def test_what_the_equation_stores_needs_every_state_measured():
    refused("v is not measured", loss=Loss(equation))
