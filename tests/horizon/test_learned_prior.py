"""The prior of a learned part: what it shrinks, whose the shared part is, what its band says."""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, Model, Start, ladder_plan, physical
from penode.arrays import Leaf
from penode.engine import (
    LearnedPrior,
    LevenbergMarquardt,
    Loss,
    Positive,
    Spline,
    TanhLayers,
    WeightDecay,
    default_plan,
)
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.learned_prior import with_priors
from penode.models.layout import Layout
from penode.training.covariance import sandwich
from penode.training.learned_effect import Visits
from penode.training.penalties import GaussianPrior
from penode.training.plan import ignore_progress

FREE = Loss(free_starts={"x": None})
STEP, SAMPLES, NOISE, RATE = 0.05, 1000, 0.01, 0.8


class Leak(Model):
    """x' = u - rate x - what is learned of x."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    rate: Leaf = physical("1/s", Positive())
    curve: Spline | TanhLayers

    def derivative(self, x, u):
        return u[0] - self.rate * x - self.learned(x)

    def learned(self, x):
        return self.curve.value_and_jacobian(x)[0]


def recorded(lacking, seed=1, span=3.0):
    """Return a recording with noise, Runge-Kutta's inputs constant over a sample."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.uniform(-span, span, SAMPLES // 20), 20)
    x, states = 0.0, np.empty(SAMPLES)
    for k, drive in enumerate(u):
        states[k] = x
        for _ in range(5):
            h = STEP / 5
            a = drive - RATE * x - lacking(x)
            b = drive - RATE * (x + h / 2 * a) - lacking(x + h / 2 * a)
            x += h * b
    return Experiment("run", STEP, {"x": states + NOISE * random.normal(size=SAMPLES), "u": u})


def outflow(x):
    """Return what the rate lacks."""
    return 0.3 * x * abs(x)


def climbed(run, prior, horizon=8, curve=None):
    """Return the only rung of a climb, and its problem."""
    curve = curve or Spline.zero((-3.0,), (3.0,), (12,), 1)
    plan = replace(ladder_plan((horizon,)), loss=FREE, learned_prior=prior)
    start = Leak(0.5, curve)
    problem = LadderProblem.of(start, [run], plan, ignore_events)
    return problem.climb(plan, problem.objective.layout.raw(start)).fits[0], problem


def learned(rung, at):
    """Return the learned map at states (point,)."""
    return _curve(rung.model.curve, at)


def _curve(curve, at):
    batched = Layout(curve)
    return np.asarray(
        batched.model(jnp.asarray(batched.raw(curve))[:, None]).value_and_jacobian(at[None])[0][0]
    )


def deviation(rung, at):
    covariance = sandwich(rung.solution.terms, rung.series)
    band = LearnedUncertainty(covariance, rung.solution.raw[None], np.ones(1))
    return band.deviation(rung.model, at[:, None])[:, 0]


def test_a_part_that_is_not_needed_shrinks_to_nothing():
    run = recorded(lambda x: 0.0)  # what the first rung learns without a prior is noise
    inside = np.linspace(*np.quantile(run.channels["x"], (0.02, 0.98)), 15)
    with_prior, without = (climbed(run, prior)[0] for prior in (LearnedPrior(), None))
    size, noise = (np.sqrt(np.mean(learned(r, inside) ** 2)) for r in (with_prior, without))
    assert size < 0.2 * noise
    assert with_prior.values[0] == pytest.approx(RATE, abs=3 * with_prior.deviation[0])


@pytest.mark.parametrize(
    "curve",
    [None, pytest.param(TanhLayers.random((1, 5, 1), seed=2), marks=pytest.mark.slow)],
)
def test_a_part_that_is_needed_is_found_with_its_band_orthogonal_to_the_physics(curve):
    run = recorded(outflow, seed=4)
    x = run.channels["x"]
    inside = np.linspace(*np.quantile(x, (0.02, 0.98)), 15)
    shared = outflow(x) @ x / (x @ x)  # of what is learned, the rate's own
    true = outflow(inside) - shared * inside
    rung, _ = climbed(run, LearnedPrior(), curve=curve)
    gap = learned(rung, inside) - true
    assert np.sqrt(np.mean(gap**2)) < 0.15 * np.sqrt(np.mean(true**2))
    assert np.mean(np.abs(gap) < 2 * deviation(rung, inside)) > 0.8
    assert abs(learned(rung, x) @ x) < 0.01 * (x @ x)
    assert rung.values[0] == pytest.approx(RATE + shared, abs=3 * rung.deviation[0])


def test_beyond_what_was_recorded_the_map_returns_to_nothing_and_the_band_grows():
    run = recorded(outflow)
    rung, _ = climbed(run, LearnedPrior())
    top = run.channels["x"].max()
    inside, beyond = np.array([0.5 * top]), np.array([2.2 * top])
    assert deviation(rung, beyond) > 3 * deviation(rung, inside)
    assert abs(learned(rung, beyond)) < 3 * deviation(rung, beyond)


def test_a_recording_shorter_than_the_visits_has_a_prior_too():
    run = recorded(outflow)
    short = Experiment("short", STEP, {name: x[:300] for name, x in run.channels.items()})
    rung, problem = climbed(short, LearnedPrior())
    visits = Visits.of(problem.objective.error, rung.solution.raw, rung.windows)
    assert len(visits.states) == len(np.unique(visits.states)) <= 300
    assert rung.values[0] == pytest.approx(RATE, abs=0.5)


def test_without_orthogonality_the_shared_part_is_nobody_s():
    run = recorded(outflow)
    apart, shared = (climbed(run, LearnedPrior(orthogonal=o))[0] for o in (True, False))
    assert shared.deviation[0] > 3 * apart.deviation[0]


def test_every_rung_has_its_own_weight_and_later_problems_have_it_too():
    run = recorded(outflow)
    start = Leak(0.5, Spline.zero((-3.0,), (3.0,), (12,), 1))
    plan = replace(ladder_plan((2, 16)), learned_prior=LearnedPrior())
    problem = LadderProblem.of(start, [run], plan, ignore_events)
    problem.climb(plan, problem.objective.layout.raw(start))
    made = [problem.problem(stage, plan).objective.loss.penalties for stage in plan.stages]
    assert [len(penalties) for penalties in made] == [1, 1]
    assert made[0][0].variance[0] != pytest.approx(made[1][0].variance[0], rel=0.1)


def test_who_gets_a_prior_by_default():
    run = recorded(lambda x: 0.0)
    start = Start(Leak(0.5, Spline.zero((-3.0,), (3.0,), (4,), 1)))
    plan = default_plan(start.model, [run])
    assert with_priors(plan, start).learned_prior == LearnedPrior()
    decay = replace(start, penalties=(WeightDecay(1.0),))
    assert with_priors(decay.with_penalties(plan), decay).learned_prior is None


@pytest.mark.parametrize(
    ("curve", "first"), [(None, False), (TanhLayers.random((1, 5, 1), seed=2), True)]
)
def test_a_network_has_its_prior_from_the_first_step_on(curve, first):
    seen = []

    class Watching(LevenbergMarquardt):
        def minimise(self, problem, raw, progress=ignore_progress):
            seen.append(any(isinstance(p, GaussianPrior) for p in problem.objective.loss.penalties))
            return super().minimise(problem, raw, progress)

    climbed(recorded(outflow), LearnedPrior(first=Watching(evaluations=5)), curve=curve)
    assert seen[0] is first
    assert all(seen[1:])
