"""The default plan: where its ladder begins and ends, how many windows, which starts are free."""

from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from penode import Experiment, InputError, Model, Predictor, identify, ladder_plan, physical
from penode.arrays import Leaf
from penode.data.windows import Jittered, cut
from penode.engine import Loss, Positive, default_plan
from penode.horizon import hold_check
from penode.horizon.default_plan import default_horizons
from penode.horizon.hold_check import better_hold, with_hold
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.holds import FirstOrderHold, ZeroOrderHold
from penode.training.residuals import Objective


class Tanks(Model):
    """Two tanks in cascade, the level of the lower measured; sizes in V and s."""

    states: ClassVar[tuple[str, ...]] = ("upper", "lower")
    inputs: ClassVar[tuple[str, ...]] = ("pump",)
    state_units: ClassVar[tuple[str, ...]] = ("V", "V")
    unmeasured: ClassVar[tuple[str, ...]] = ("upper",)

    outflow: Leaf = physical("V^0.5/s", Positive())
    inflow: Leaf = physical("1/s", Positive())

    def derivative(self, x, u):
        upper, lower = jnp.sqrt(jnp.maximum(x, 1e-3))
        return jnp.stack(
            [self.inflow * u[0] - self.outflow * upper, self.outflow * (upper - lower)]
        )


class Whole(Tanks):
    """The same with both levels measured."""

    unmeasured: ClassVar[tuple[str, ...]] = ()


OUTFLOW, INFLOW, STEP, NOISE = 0.05, 0.045, 4.0, 0.03


@pytest.fixture(scope="module")
def run():
    return tanks(2)


def tanks(seed):
    """Return 600 samples by SciPy, noise on the lower level."""
    random = np.random.default_rng(seed)
    pump = np.repeat(random.uniform(1.0, 5.0, 40), 15)

    def rate(t, x, u):
        upper, lower = np.sqrt(np.maximum(x, 0))
        return [INFLOW * u - OUTFLOW * upper, OUTFLOW * (upper - lower)]

    levels = [np.array([6.0, 5.0])]
    for u in pump[:-1]:
        step = solve_ivp(rate, (0.0, STEP), levels[-1], args=(u,), rtol=1e-9, atol=1e-9)
        levels.append(step.y[:, -1])
    lower = np.array(levels)[:, 1] + NOISE * random.normal(size=len(pump))
    return Experiment("tanks", STEP, {"pump": pump, "lower": lower})


def recording(samples):
    k = np.arange(float(samples))
    return Experiment("run", 1.0, {"pump": k, "lower": k, "upper": k})


@pytest.mark.parametrize(
    ("model", "samples", "first", "last"),
    [(Tanks, 1024, 7, 819), (Whole, 1024, 1, 819), (Tanks, 20_000, 7, 1000), (Tanks, 9, 7, 7)],
)
def test_a_ladder_begins_where_a_start_is_overdetermined_and_ends_at_most_of_a_recording(
    model, samples, first, last
):
    found = default_horizons(model(OUTFLOW, INFLOW), [recording(samples)])
    assert (found[0], found[-1]) == (first, last)
    growth = np.array(found[1:]) / np.array(found[:-1])
    assert ((growth > 1.4) & (growth <= 2.5)).all()


def test_a_long_recording_has_forty_windows_of_the_longest_horizon():
    found = default_horizons(Tanks(OUTFLOW, INFLOW), [recording(400_000)])
    assert found[-1] == 10_000


@pytest.mark.parametrize(
    ("horizon", "windows"), [(10, 102), (25, 42), (64, 40), (200, 17), (819, 5)]
)
def test_windows_overlap_where_few_fit_and_at_most_four_of_them(horizon, windows):
    starts = Jittered(3, fewest=40).starts(0, 1023 - horizon, horizon)
    assert len(starts) == windows
    assert (starts >= 0).all()
    assert (starts <= 1023 - horizon).all()
    assert len(starts) * horizon <= max(1024 + horizon, 4 * 1024)
    assert len(Jittered(3, fewest=4000).starts(0, 1023 - horizon, horizon)) >= windows


def test_a_start_that_is_one_more_sample_weighs_as_one_residual():
    """A deviation of None is that of the channel's scale; the losses and their slopes agree."""
    random = np.random.default_rng(1)
    channels = {name: random.uniform(1, 3, 50) for name in ("pump", "lower", "upper")}
    model, scale = Whole(OUTFLOW, INFLOW), np.array([0.7, 1.3])
    windows = cut([Experiment("run", 1.0, channels)], model.states, model.inputs, 5)
    terms = []
    for deviations in ((None, None), scale):
        loss = Loss(free_starts=dict(zip(model.states, deviations, strict=True)))
        objective = Objective(Predictor(1.0, DEFAULT_SOLVER), model, scale, loss, 1)
        terms.append(objective.gauss_newton(objective.layout.raw(model), windows))
    assert terms[0].loss == pytest.approx(terms[1].loss, rel=1e-12)
    np.testing.assert_allclose(terms[0].normal, terms[1].normal, rtol=1e-9)


@pytest.mark.slow
def test_tanks_of_which_one_is_measured_are_right_by_default(run):
    """From a start 60 % off. At H = 1 and 2 the free level fits whatever the parameters are."""
    fit = identify(Tanks(0.08, 0.08), [run])
    assert fit.horizon.verdict == "plateau"
    assert fit.parameters["outflow"].value == pytest.approx(OUTFLOW, rel=0.02)
    assert fit.parameters["inflow"].value == pytest.approx(INFLOW, rel=0.02)
    assert fit.comparisons[0].free_run_rmse == pytest.approx(NOISE, rel=0.2)


class Blind(Tanks):
    """The same with no level measured."""

    unmeasured: ClassVar[tuple[str, ...]] = Tanks.states


def test_a_model_without_a_measured_state_is_refused():
    with pytest.raises(InputError, match="no state of Blind is measured"):
        default_plan(Blind(OUTFLOW, INFLOW), [recording(100)])


def test_at_least_one_window_is_wanted():
    with pytest.raises(InputError, match="fewest must be >= 1 window, got 0"):
        Jittered(fewest=0)


def test_a_hold_whose_predictions_diverge_is_not_taken(run, monkeypatch):
    start, solutions = Start(Tanks(OUTFLOW, INFLOW)), LadderProblem.solutions
    plan = default_plan(start.model, [run])
    assert with_hold(plan, start, [run]) is plan  # inputs that are held

    def diverging(problem, plan, raw):
        return iter(()) if plan.hold == ZeroOrderHold() else solutions(problem, plan, raw)

    monkeypatch.setattr(LadderProblem, "solutions", diverging)
    assert with_hold(plan, start, [run]).hold != ZeroOrderHold()


def test_training_that_did_not_converge_compares_no_holds(run, monkeypatch):
    """Which end of several minima is nearest says nothing of the input."""
    start, tried, solutions = Start(Tanks(OUTFLOW, INFLOW)), [], LadderProblem.solutions

    def unfinished(problem, plan, raw):
        tried.append(plan.hold)
        for stage, end in solutions(problem, plan, raw):
            yield stage, replace(end, outcome="The evaluations are used up.")

    monkeypatch.setattr(LadderProblem, "solutions", unfinished)
    plan = default_plan(start.model, [run])
    assert with_hold(plan, start, [run]) is plan
    assert tried == [ZeroOrderHold()]


class Lag(Model):
    """x' = a (u - x)."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("V",)

    a: Leaf = physical("1/s")

    def derivative(self, x, u):
        return self.a * (u[0] - x[0])[None]


RATE, SAMPLED = 2.0, 0.1


def held(hold, random):
    """Return an input at samples and the lag's answer to it between them, in closed form."""
    if hold == BandLimitedHold():
        t = SAMPLED * np.arange(400)[:, None]
        frequency, phase = random.uniform(2, 25, 20), random.uniform(0, 2 * np.pi, 20)
        turned = np.exp(1j * (t * frequency + phase))
        answer = RATE / (RATE + 1j * frequency)
        return turned.real.sum(axis=1), (answer * turned).real.sum(axis=1)
    u = np.cumsum(random.normal(size=400))
    x, kept = np.zeros(400), np.exp(-RATE * SAMPLED)
    for k in range(399):
        slope = (u[k + 1] - u[k]) / SAMPLED if hold == FirstOrderHold() else 0.0
        steady = u[k] - slope / RATE  # a ramp is followed 1/a behind
        x[k + 1] = steady + slope * SAMPLED + kept * (x[k] - steady)
    return u, x


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("hold", [ZeroOrderHold(), FirstOrderHold(), BandLimitedHold()])
def test_the_recordings_show_how_the_input_goes_on(hold, noise):
    """Also where what is recorded of the input is noisy."""
    random = np.random.default_rng(3)
    u, x = held(hold, random)
    channels = {"u": u + noise * random.normal(size=400), "x": x + 0.01 * random.normal(size=400)}
    experiment, start = Experiment("lag", SAMPLED, channels), Start(Lag(1.0))
    plan = with_hold(default_plan(start.model, [experiment]), start, [experiment])
    assert plan.hold == hold
    if not noise:
        fit = identify(start.model, [experiment])
        assert fit.parameters["a"].value == pytest.approx(RATE, rel=0.01)


@pytest.mark.parametrize("seed", [3, 7, 10])
def test_noise_at_the_first_horizon_makes_no_hold(seed):
    """Commands that stand still for 15 samples; at H = 7 noise hides what either hold does."""
    start = Start(Tanks(0.08, 0.08))
    plan = with_hold(default_plan(start.model, [tanks(seed)]), start, [tanks(seed)])
    assert plan.hold == ZeroOrderHold()


@pytest.mark.parametrize(
    ("straight", "converged", "taken"),
    [
        # As a circuit with constant inputs: one step speaks for ramps, longer windows against them.
        ((-3.003, -2.98, -2.96), [0, 1, 2], ZeroOrderHold()),
        # What speaks against them did not converge.
        ((-3.003, -2.98, -2.96), [0], FirstOrderHold()),
        # Noise hides ramps in the first windows.
        ((-2.998, -3.01, -3.02), [0, 1, 2], FirstOrderHold()),
        # As good: the simplest.
        ((-3.0, -3.0, -3.0), [0, 1, 2], ZeroOrderHold()),
    ],
)
def test_the_horizon_that_speaks_most_against_a_hold_decides(
    run, monkeypatch, straight, converged, taken
):
    logarithms = {
        ZeroOrderHold(): [-3.0, -3.0, -3.0],
        FirstOrderHold(): list(straight),
        BandLimitedHold(): [-2.0, -2.0, -2.0],
    }

    tried = []

    def trial(plan, *given):
        losses = logarithms[plan.hold]
        tried.append(plan.hold)
        return SimpleNamespace(log_losses=losses, comparable=converged, fine_solver=plan.solver)

    monkeypatch.setattr(hold_check._Trial, "of", trial)
    start = Start(Tanks(OUTFLOW, INFLOW))
    assert with_hold(default_plan(start.model, [run]), start, [run]).hold == taken
    # What stands still better than it goes on straight does not go on smoothly either.
    assert len(tried) == (2 if taken == ZeroOrderHold() else 3)


@pytest.mark.parametrize("true", [ZeroOrderHold(), FirstOrderHold(), BandLimitedHold()])
def test_a_wrong_hold_is_found_at_the_rung_that_was_chosen(true):
    """Training goes on from its parameters; the right one stays."""
    random = np.random.default_rng(3)
    u, x = held(true, random)
    run = Experiment("lag", SAMPLED, {"u": u, "x": x + 0.01 * random.normal(size=400)})
    for assumed in (ZeroOrderHold(), FirstOrderHold()):
        plan = replace(default_plan(Lag(1.0), [run]), hold=assumed)
        plan = replace(plan, stages=plan.stages[:4])
        problem = LadderProblem.of(Lag(1.0), [run], plan, ignore_events)
        rung = problem.climb(plan, problem.objective.layout.raw(Lag(1.0))).fits[-1]
        other = better_hold(problem, plan, rung)
        assert (other[0].hold if other else assumed) == true
        if other:
            assert problem.objective.layout.values(other[1])[0] == pytest.approx(RATE, rel=0.01)


def test_a_hold_that_cannot_win_is_not_trained(monkeypatch):
    """One evaluation shows it, where the right hold is already taken."""
    random = np.random.default_rng(3)
    u, x = held(ZeroOrderHold(), random)
    run = Experiment("lag", SAMPLED, {"u": u, "x": x + 1e-4 * random.normal(size=400)})
    plan = replace(default_plan(Lag(1.0), [run]), stages=ladder_plan((4,)).stages)
    problem = LadderProblem.of(Lag(1.0), [run], plan, ignore_events)
    rung = problem.climb(plan, problem.objective.layout.raw(Lag(1.0))).fits[-1]

    def refuse(*given):
        raise AssertionError("it was trained")

    asked, with_predictor = [], LadderProblem.with_predictor

    def noted(problem, plan, rung):
        asked.append(plan.hold)
        return with_predictor(problem, plan, rung)

    monkeypatch.setattr(LadderProblem, "with_predictor", noted)
    monkeypatch.setattr(hold_check.LevenbergMarquardt, "minimise", refuse)
    assert better_hold(problem, plan, rung) is None
    assert asked == [FirstOrderHold()]  # nor can a smoother one win


def test_the_plan_serves_a_climb(run):
    plan = default_plan(Tanks(OUTFLOW, INFLOW), [run], seed=4)
    assert plan.placement == Jittered(4, fewest=40)
    assert dict(plan.loss.free_starts) == {"lower": None}
    problem = LadderProblem.of(Tanks(OUTFLOW, INFLOW), [run], plan, lambda event: None)
    assert len(problem.problem(plan.stages[-1], plan).windows) >= 4
