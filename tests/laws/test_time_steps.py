"""Several sampling intervals in one fit: sums over recordings are those of each, at its own step.

A pendulum is recorded at 10 ms and at 50 ms; the recordings are simulated by SciPy.
"""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from penode import (
    Experiment,
    InputError,
    Jittered,
    Model,
    Plan,
    Predictor,
    Stage,
    identify,
    ladder_plan,
    physical,
)
from penode.data.rates import lengths, require_one_time_step, steps_in, time_steps
from penode.data.windows import Contiguous, cut
from penode.horizon.default_plan import default_horizons
from penode.horizon.selection import Longest
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.holds import ZeroOrderHold
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import RK4
from penode.training.chunks import CHUNK
from penode.training.first_order import FirstOrder
from penode.training.loss import Loss
from penode.training.residuals import Objective
from penode.training.window_states import mean_states, start_states
from penode.validation.free_run import compare

pytestmark = pytest.mark.usefixtures("quickly_compiled")

TRUTH = {"pull": 30.0, "damping": 0.4}
FAST, SLOW, NOISE = 0.01, 0.05, 0.01


class Pendulum(Model):
    """The angle is measured and the rate is not."""

    states: ClassVar = ("angle", "rate")
    inputs: ClassVar = ("torque",)
    state_units: ClassVar = ("rad", "rad/s")
    unmeasured: ClassVar = ("rate",)

    pull: object = physical("1/s2")
    damping: object = physical("1/s")

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0] - self.pull * jnp.sin(x[0]) - self.damping * x[1]])


def recorded(name, step, count, seed):
    """Return a recording whose torque changes every fourth sample."""
    random, time = np.random.default_rng(seed), step * np.arange(count)
    torque = 8.0 * random.normal(size=count // 4 + 1).repeat(4)[:count]

    def rate(t, x):
        acting = torque[min(int(t / step + 1e-9), count - 1)]
        return [x[1], acting - TRUTH["pull"] * np.sin(x[0]) - TRUTH["damping"] * x[1]]

    options = {"max_step": step / 2, "rtol": 1e-6, "atol": 1e-8}
    angle = solve_ivp(rate, (0, time[-1]), [0.3, 0.0], t_eval=time, **options).y[0]
    noisy = angle + NOISE * random.normal(size=count)
    return Experiment(name, step, {"angle": noisy, "torque": torque})


@pytest.fixture(scope="module")
def runs():
    """Return 7 s at 10 ms and 14 s at 50 ms."""
    return [recorded("fast", FAST, 700, 1), recorded("slow", SLOW, 280, 2)]


def objective_at(step, solver=None, hold=None, free=None):
    predictor = Predictor(step, solver or RungeKutta(RK4), hold or ZeroOrderHold())
    loss = Loss(free_starts={"angle": None} if free is None else free)
    return Objective(predictor, Pendulum(**TRUTH), np.ones(2), loss)


def windows_of(some, objective, horizon):
    guessed = [
        replace(e, channels={**e.channels, "rate": np.zeros(len(e))})
        if "rate" not in e.channels
        else e
        for e in some
    ]
    options = {"prepared": objective.predictor.prepared, "placement": Jittered(3)}
    found = cut(guessed, Pendulum.states, Pendulum.inputs, horizon, **options)
    # Starts that are far are looked for until all of a chunk are found: one chunk of any partition.
    first, second = (np.flatnonzero(found.recording == k) for k in (0, 1))
    return found.among(np.concatenate([first[: CHUNK // 4], second[: CHUNK // 4]]))


# --- lengths ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("horizon", "step", "expected"),
    [(1, 0.05, 1), (7, 0.05, 1), (8, 0.05, 2), (100, 0.05, 20), (9, 0.01, 9), (10, 0.025, 4)],
)
def test_a_horizon_is_as_long_in_time_in_every_recording(horizon, step, expected):
    assert steps_in(horizon, FAST, step) == expected


def test_windows_stay_within_their_recording(runs):
    windows = windows_of(runs, objective_at(FAST), 40)
    assert (windows.time_step, windows.horizon) == (FAST, 40)
    np.testing.assert_array_equal(windows.time_steps, [FAST, SLOW])
    np.testing.assert_array_equal(np.unique(windows.steps[windows.recording == 1]), [8])
    ends = windows.starts + windows.steps
    assert (ends < np.array([700, 980])[windows.recording]).all()
    assert (windows.starts >= np.array([0, 700])[windows.recording]).all()
    assert lengths(runs) == [700, 1400]
    assert windows_of(runs[::-1], objective_at(FAST), 40).time_step == FAST


def test_steps_equal_but_for_rounding_are_one():
    near = [recorded("one", FAST, 60, 1), recorded("other", FAST * (1 + 5e-7), 60, 1)]
    assert windows_of(near, objective_at(FAST), 5).time_steps is None
    np.testing.assert_array_equal(time_steps(near), FAST)


def test_with_hidden_states_the_ladder_begins_where_slow_windows_show_more_than_their_start(runs):
    alone = default_horizons(Pendulum(**TRUTH), runs[1:])[0]
    assert default_horizons(Pendulum(**TRUTH), runs)[0] == alone * round(SLOW / FAST)


# --- sums ---------------------------------------------------------------------------------------

SOLVERS = {
    "constant inputs": (RungeKutta(RK4), ZeroOrderHold()),
    "tabulated inputs": (Substeps(RungeKutta(RK4), 2), BandLimitedHold()),
}


@pytest.mark.parametrize(
    ("name", "free"),
    [
        ("constant inputs", {}),
        pytest.param("tabulated inputs", {"angle": None}, marks=pytest.mark.slow),
    ],
)
def test_sums_are_those_of_each_recording_at_its_own_step(runs, name, free):
    both, raw = objective_at(FAST, *SOLVERS[name], free=free), np.array([27.0, 0.6])
    windows = windows_of(runs, both, 40)
    terms = both.gauss_newton(raw, windows)
    parts = []
    for run, step, horizon in ((runs[0], FAST, 40), (runs[1], SLOW, 8)):
        alone = objective_at(step, *SOLVERS[name], free=free)
        own = windows_of([run], alone, horizon)
        # Draws of a recording depend on where it begins among all.
        first = 0 if run is runs[0] else len(runs[0])
        placed = windows.starts[windows.recording == (0 if run is runs[0] else 1)] - first
        own = replace(own, starts=placed, recording=0 * placed)
        parts.append(alone.gauss_newton(raw, own))
    assert terms.count == sum(part.count for part in parts)
    squares = sum(part.loss * part.count for part in parts)
    assert terms.loss * terms.count == pytest.approx(squares, rel=1e-10)
    for field in ("normal", "descent"):
        total = sum(getattr(part, field) for part in parts)
        np.testing.assert_allclose(getattr(terms, field), total, rtol=1e-10)
    scores = np.concatenate([part.scores for part in parts], axis=1)
    np.testing.assert_allclose(terms.scores, scores, rtol=1e-10, atol=1e-10 * abs(scores).max())
    loss, slope = both.loss_and_gradient(raw, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-10)
    # Both find the starts by themselves, to a tolerance.
    np.testing.assert_allclose(slope, -2 * terms.descent / terms.count, rtol=1e-6)
    by_sample = both.sample_scores(raw, windows)
    np.testing.assert_allclose(by_sample.sum(axis=1), scores.sum(axis=1), rtol=1e-7)


def test_two_steps_that_are_equal_give_what_one_gives(runs):
    """Windows are told apart by a step that differs in the last digit."""
    two = [runs[0], recorded("again", FAST, 500, 5)]
    one, raw = objective_at(FAST), np.array([27.0, 0.6])
    windows = windows_of(two, one, 40)
    apart = replace(windows, time_steps=np.array([FAST, FAST * (1 + 1e-13)]))
    assert windows.time_steps is None
    assert len(apart.by_time_step) == 2
    together, split = (one.gauss_newton(raw, each) for each in (windows, apart))
    assert split.loss == pytest.approx(together.loss, rel=1e-10)
    for field in ("normal", "descent", "scores"):
        first, second = getattr(together, field), getattr(split, field)
        np.testing.assert_allclose(second, first, rtol=1e-10, atol=1e-10 * abs(first).max())
    given = one.error, raw
    for states in (start_states, mean_states):
        np.testing.assert_allclose(states(*given, apart), states(*given, windows), rtol=1e-10)


# --- fits ---------------------------------------------------------------------------------------


def fitted(some, horizons):
    """Fit windows that overlap, so that few of them show the deviation well."""
    plan = ladder_plan(horizons)
    loss = Loss(free_starts={"angle": None})
    plan = replace(plan, loss=loss, placement=Jittered(0, fewest=40))
    return identify(Pendulum(pull=25.0, damping=0.6), some, plan=plan, purpose=Longest())


@pytest.mark.slow
def test_one_fit_of_both_covers_the_truth_and_is_surer_than_either(runs):
    both = fitted(runs, (50, 100, 200))
    alone = [fitted(runs[:1], (50, 100, 200)), fitted(runs[1:], (10, 20, 40))]
    for name, true in TRUTH.items():
        low, high = both.parameters[name].interval_95
        assert low < true < high
        assert both.parameters[name].std < min(fit.parameters[name].std for fit in alone)
    assert both.predictor.time_step == FAST
    assert [one.time_step for one in both.comparisons] == [FAST, SLOW]
    assert all(error < 2 * NOISE for one in both.comparisons for error in [one.free_run_rmse])


@pytest.mark.slow  # so does the how-to on recordings as they are
def test_the_default_plan_takes_them(runs):
    fit = identify(Pendulum(pull=25.0, damping=0.6), runs, validation=[runs[1].part(100, 300)])
    assert fit.horizon.verdict == "plateau"
    assert set(fit.initial_states) == {"fast", "slow"}
    for name, true in TRUTH.items():
        low, high = fit.parameters[name].interval_95
        assert low < true < high
    slow = runs[1]
    assert fit.free_run_deviation(slow).shape == (len(slow), 1)
    again = fit.compare(slow)
    assert again.free_run_rmse < 2 * NOISE
    np.testing.assert_array_equal(
        again.free_run, compare(fit.predictor.at(SLOW), fit.model, slow).free_run
    )


# --- refusals -----------------------------------------------------------------------------------


def test_a_step_that_was_not_trained_on_is_refused(runs):
    other = replace(recorded("other", 0.02, 200, 4))
    with pytest.raises(
        InputError, match=r"other: time step must be 0\.01 s, as trained, got 0\.02"
    ):
        identify(Pendulum(**TRUTH), runs, plan=ladder_plan((30,)), validation=[other])


def test_an_optimiser_of_first_order_refuses_them(runs):
    plan = Plan((Stage(40, FirstOrder(epochs=1)),), Contiguous())
    with pytest.raises(InputError, match="one time step for an optimiser of first order"):
        identify(Pendulum(**TRUTH), runs, plan=plan)


def test_where_one_step_is_needed_the_recording_is_named(runs):
    with pytest.raises(InputError, match=r"slow: the time step is 0\.05 s where fast has 0\.01 s"):
        require_one_time_step(runs)
