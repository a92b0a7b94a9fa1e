"""A network of more parameters than a normal matrix may have rows."""

from dataclasses import replace

import numpy as np
import pytest
from tests.conftest import DAMPING, MASS, Duffing, cubic_spring, oscillation

from penode import Fit, Start, identify, ladder_plan
from penode.arrays import float64, on_device
from penode.engine import Spline, TanhLayers
from penode.errors import InputError
from penode.horizon import wide_networks
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.wide_networks import with_held_layers
from penode.models.last_layer import Constant, LastLayer, last_layers
from penode.models.layout import Layout
from penode.report.fit_report import fit_report

NETWORK = TanhLayers.random((1, 10, 10, 1), seed=3)
PLAN = ladder_plan((3,))


@pytest.fixture
def few(monkeypatch):
    """Let a fit have 100 parameters; the network alone has 141."""
    monkeypatch.setattr(wide_networks, "MOST_PARAMETERS", 100)
    monkeypatch.setattr(wide_networks, "_ITERATIONS", 30)


@pytest.fixture(scope="module")
def run():
    return oscillation("train.csv", 400, 1.0)


def test_physics_is_right_beside_its_last_layer(few, run, tmp_path):
    seen = []
    start = Start(Duffing(NETWORK, mass=1.0, damping=0.1), warnings=("It was windy.",))
    fit = identify(start, [run], plan=PLAN, observer=seen.append)
    for name, true in (("mass", MASS), ("damping", DAMPING)):
        low, high = fit.parameters[name].interval_95
        assert low < true < high
        assert high - low < 0.1 * true
    x = np.linspace(run.channels["x"].min(), run.channels["x"].max(), 50)
    error = fit.spring(x) - cubic_spring(x)
    assert np.sqrt(np.mean(error**2)) < 0.05 * np.std(cubic_spring(x))
    windy, note = fit.warnings[:2]
    assert windy == "It was windy."
    assert note == (
        "The model has 143 parameters: 130 of hidden layers were trained first, at horizon 3, and "
        "held; intervals and bands are those of the other 13."
    )
    descent = [e for e in seen if e["event"] == "evaluation"]
    assert descent[0]["horizon"] == 3
    assert descent[0]["stages"] == 1
    assert "could not be made" not in fit_report(fit)
    fit.save(tmp_path / "fit")
    again = Fit.load(tmp_path / "fit", trust=True)
    assert isinstance(again.model.spring, LastLayer)
    np.testing.assert_array_equal(again.compare(run).free_run, fit.compare(run).free_run)


def test_a_model_within_the_limit_stays_as_it_is(few, run):
    start = Start(Duffing(TanhLayers.random((1, 3, 1), seed=1), mass=1.0, damping=0.1))
    problem = LadderProblem.of(start.model, [run], PLAN, ignore_events)
    assert with_held_layers(start, problem, PLAN) is start


@pytest.mark.parametrize(
    ("part", "size"),
    [
        (Spline.zero((-3.0,), (3.0,), (200,), 1), 205),
        (TanhLayers.random((1, 120, 1), seed=0), 123),
    ],
    ids=["a spline", "a last layer"],
)
def test_what_is_too_large_all_the_same_is_refused_before_training(few, run, part, size):
    with pytest.raises(InputError) as caught:
        identify(Duffing(part, mass=1.0, damping=0.1), [run], plan=PLAN)
    assert str(caught.value).startswith(
        f"parameters of a fit must be <= 100, hidden layers of TanhLayers apart, got {size}: "
    )


def test_a_held_network_is_the_network_and_linear_in_what_is_left(rng):
    whole = Duffing(NETWORK, mass=1.0, damping=0.1)
    held = last_layers(whole)
    layout = Layout(held)
    assert layout.size == 13
    assert layout.linear_members.sum() == 11
    x = rng.normal(size=(1, 7))
    with float64():
        values = [
            layout_of.model(layout_of.values(on_device(layout_of.raw(model)))[:, None])
            for model, layout_of in ((whole, Layout(whole)), (held, layout))
        ]
        (value, jacobian), (same, as_steep) = (
            model.spring.value_and_jacobian(on_device(x)) for model in values
        )
    np.testing.assert_allclose(same, value, rtol=1e-13)
    np.testing.assert_allclose(as_steep, jacobian, rtol=1e-13)


def test_layouts_are_one_only_with_the_same_hidden_layers():
    """Programs are compiled for a layout: numbers that it holds are part of it."""
    one, same = (last_layers(Duffing(NETWORK, 1.0, 0.1)) for _ in range(2))
    other = last_layers(Duffing(TanhLayers.random((1, 10, 10, 1), seed=4), 1.0, 0.1))
    assert Layout(one) == Layout(same)
    assert hash(Layout(one)) == hash(Layout(same))
    assert Layout(one) != Layout(other)
    assert Constant(np.zeros(4)) != Constant(np.zeros((2, 2)))
    assert Layout(replace(one, spring=NETWORK)) != Layout(one)
