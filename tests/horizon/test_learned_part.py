"""A learned part beside the physics: freed after it, kept where it predicts what was left out."""

import sys
from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, Model, Start, identify, ladder_plan, physical
from penode.arrays import Leaf, float64
from penode.engine import Loss, Positive, Spline, TanhLayers
from penode.errors import InputError
from penode.horizon import learned_part
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.learned_part import searched
from penode.horizon.search import Search
from penode.horizon.selection import Longest
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.models.parameters import with_batch_axis
from penode.models.wrapped import WithoutPart

STEP, SAMPLES, NOISE, RATE = 0.05, 800, 0.01, 0.8
PLAN = replace(ladder_plan((4, 8)), loss=Loss(free_starts={"x": None}))


class Leak(Model):
    """x' = u - rate x - what is learned of x."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    curve: Spline | TanhLayers
    rate: Leaf = physical("1/s", Positive())

    def derivative(self, x, u):
        return u[0] - self.rate * x - self.learned(x)

    def learned(self, x):
        return self.curve.value_and_jacobian(x)[0]


def leak(size=0.0):
    curve = Spline.zero((-3.0,), (3.0,), (8,), 1)
    return Leak(replace(curve, coefficients=curve.coefficients + size), 0.5)


def recorded(lacking, seed=1):
    """Return a recording with noise, inputs constant over a sample."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.uniform(-3.0, 3.0, SAMPLES // 20), 20)
    x, states = 0.0, np.empty(SAMPLES)
    for k, drive in enumerate(u):
        states[k] = x
        for _ in range(5):
            h = STEP / 5
            a = drive - RATE * x - lacking * x * abs(x)
            b = x + h / 2 * a
            x += h * (drive - RATE * b - lacking * b * abs(b))
    return Experiment("run", STEP, {"x": states + NOISE * random.normal(size=SAMPLES), "u": u})


@pytest.fixture(scope="module", autouse=True)
def hold_as_it_is():
    """Leave the inputs constant, as they were."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learned_part, "with_hold", lambda plan, *given: plan)
        yield


def found(run, observer=ignore_events):
    return searched(Search(Start(leak()), [run], Longest(), observer), PLAN)


def last(one):
    """Return the values of the last rung, and its learned coefficients; none without the part."""
    rung = one.climbed.climb.fits[-1]
    apart = isinstance(rung.model, WithoutPart)
    return rung.values[0], None if apart else rung.model.curve.coefficients


def test_the_model_without_its_part_is_that_with_it_as_it_was_given():
    whole = leak(0.4)
    apart = WithoutPart.of(whole)
    x, u = jnp.linspace(-2.0, 2.0, 7)[None], Inputs(jnp.ones((1, 7)), ("u",))
    with float64():
        rates = [np.asarray(with_batch_axis(m).derivative(x, u)) for m in (whole, apart)]
    assert rates[1] == pytest.approx(rates[0], rel=1e-12)
    assert Layout(apart).names == ("rate",)
    assert Layout(apart).size == 1
    assert apart.whole.curve.coefficients == pytest.approx(whole.curve.coefficients)
    assert WithoutPart.of(apart) is None  # nothing is learned any more
    assert WithoutPart.of(whole.curve) is None  # nothing is left without


def test_a_part_that_is_needed_stays():
    one = found(recorded(0.3))
    assert "stays in the model" in one.start.facts["learned_part"]
    assert not one.start.warnings
    value, coefficients = last(one)
    assert np.abs(coefficients).max() > 0.1
    x = recorded(0.3).channels["x"]
    shared = 0.3 * (x * abs(x)) @ x / (x @ x)
    assert value == pytest.approx(RATE + shared, rel=0.03)


@pytest.mark.slow
def test_a_network_that_is_needed_is_trained_from_the_shortest_horizon_on(monkeypatch):
    heard, judged, left_out = [], [], learned_part._left_out

    def judging(climbed, index):
        judged.append(climbed.climb.fits[index].horizon)
        return left_out(climbed, index)

    monkeypatch.setattr(learned_part, "_left_out", judging)
    network = TanhLayers.random((1, 4, 1), seed=2)
    given = Leak(network, 0.5)
    run = recorded(0.3)
    stages = ladder_plan((2, 4, 8, 16, 32)).stages
    plan = replace(PLAN, stages=stages)
    one = searched(Search(Start(given), [run], Longest(), heard.append), plan)
    assert "stays in the model" in one.start.facts["learned_part"]
    rungs = [event["horizon"] for event in heard if event["event"] == "rung"]
    assert rungs[:3] == [2, 4, 8]  # the physics alone, half way up
    assert rungs[3:5] == [2, 8]  # the network, on every second of these
    assert judged == [8, 8]  # both at the last of them
    assert rungs[-1] == 32
    value = one.climbed.climb.fits[-1].values[0]
    x = run.channels["x"]
    assert value == pytest.approx(RATE + 0.3 * (x * abs(x)) @ x / (x @ x), rel=0.05)


@pytest.mark.slow
def test_beside_a_network_that_diverges_the_physics_alone_is_climbed_whole(monkeypatch):
    def diverging(*given):
        raise InputError("the predictions diverge.")

    monkeypatch.setattr(learned_part, "_freed", diverging)
    plan = replace(PLAN, stages=ladder_plan((2, 4, 8, 16, 32)).stages)
    given = Leak(TanhLayers.random((1, 4, 1), seed=2), 0.5)
    one = searched(Search(Start(given), [recorded(0.0)], Longest(), ignore_events), plan)
    (sentence,) = one.start.warnings
    assert "no part of the recordings can be left out" in sentence
    assert [rung.horizon for rung in one.climbed.climb.fits] == [2, 4, 8, 16, 32]


def test_a_part_that_is_not_needed_is_left_as_it_was_given():
    run = recorded(0.0)
    one = found(run)
    (sentence,) = one.start.warnings
    assert "left as it was given" in sentence
    value, coefficients = last(one)
    assert coefficients is None
    apart = WithoutPart.of(leak())
    problem = LadderProblem.of(apart, [run], PLAN, ignore_events)
    alone = problem.climb(PLAN, problem.objective.layout.raw(apart)).fits[-1]
    assert value == pytest.approx(alone.values[0], rel=1e-9)


def test_a_fit_without_the_part_has_the_model_that_was_given(monkeypatch):
    monkeypatch.setattr(sys.modules["penode.identify"], "default_plan", lambda *given: PLAN)
    given = leak(0.0)
    fit = identify(given, [recorded(0.0)])
    assert isinstance(fit.model, Leak)
    assert isinstance(fit.simulation, Leak)
    assert "left as it was given" in fit.provenance["learned_part"]
    assert fit.model.curve.coefficients == pytest.approx(given.curve.coefficients)
    assert fit.learned_deviation(np.array([[0.5], [1.0]])) == pytest.approx(np.zeros((2, 1)))
    shown = fit.learned_uncertainty.covariance
    assert shown[-1, -1] > 0
    assert np.count_nonzero(shown) == 1


def test_an_interrupted_trial_leaves_the_physics_alone(monkeypatch):
    seen = []

    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(learned_part, "_freed", interrupted)
    one = found(recorded(0.3), seen.append)
    assert one.check.interrupted
    assert last(one)[1] is None
    assert seen[-1]["event"] == "stop"


def test_a_part_that_diverges_when_freed_is_left_as_it_was_given(monkeypatch):
    def diverges(*given):
        raise learned_part.InputError("the predictions diverge")

    monkeypatch.setattr(learned_part, "_freed", diverges)
    (sentence,) = found(recorded(0.3)).start.warnings
    assert "left as it was given" in sentence
