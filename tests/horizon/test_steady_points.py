"""Points at rest beside recordings: one objective, and what it says of each point."""

from dataclasses import replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from tests.horizon.test_profile import GAIN, PLAN, RATE, STEP, Decay, errors

from penode import (
    Experiment,
    Fit,
    InputError,
    Model,
    Start,
    identify,
    ladder_plan,
    physical,
)
from penode.arrays import float64
from penode.engine import ExtendedKalman, SteadyPoints
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.training.steady_points import state_of_rest

NOISE, SURE = 0.05, 0.02


class Tanks(Model):
    """Two tanks in a row, of which nothing but a pressure below is measured."""

    states: ClassVar = ("upper", "lower")
    inputs: ClassVar = ("inflow",)
    state_units: ClassVar = ("m", "m")
    outputs: ClassVar = {"pressure": "bar"}

    first: object = physical("1")
    second: object = physical("1")

    def derivative(self, x, u):
        out = [jnp.sqrt(jnp.abs(level) + 1e-9) for level in x]
        through = self.first * out[0]
        return jnp.stack([u["inflow"] - through, through - self.second * out[1]])

    def output(self, x, u):
        return (0.1 * x[1] + 0.01 * u["inflow"])[None]


@pytest.fixture(scope="module")
def run():
    random = np.random.default_rng(3)
    u, x = np.sign(random.normal(size=80)).repeat(5), [0.0]
    for held in u[:-1]:
        ahead = held * GAIN + (x[-1] - held * GAIN) * np.exp(-RATE * STEP)
        x.append(ahead + NOISE * random.normal())  # one step ahead all is independent
    return Experiment("run", STEP, {"x": np.array(x), "u": u})


@pytest.fixture(scope="module")
def points():
    u = np.array([-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0])
    measured = GAIN * u + SURE * np.random.default_rng(4).normal(size=8)
    return SteadyPoints({"u": u, "x": measured}, {"x": SURE}, "bench")


@pytest.fixture(scope="module")
def fit(run, points):
    return identify(Start(Decay(1.0, 1.0), points=points), [run], plan=PLAN)


def test_rest_and_its_slopes_are_the_closed_form():
    with float64():
        model, inflow = Tanks(0.5, 0.4), np.array([0.2, 0.7, 1.5])

        def rest(values):
            layout = Layout(model)
            u = Inputs(jnp.asarray(inflow)[None], model.inputs)
            return state_of_rest(layout.model(values[:, None]), jnp.zeros((2, 3)), u)

        values = jnp.asarray([0.5, 0.4])
        found, slopes = np.asarray(rest(values)), np.asarray(jax.jacfwd(rest)(values))
    levels = (inflow / np.array([[0.5], [0.4]])) ** 2
    np.testing.assert_allclose(found, levels, rtol=1e-6)
    expected = np.zeros((2, 3, 2))
    expected[0, :, 0], expected[1, :, 1] = -2 * levels[0] / 0.5, -2 * levels[1] / 0.4
    np.testing.assert_allclose(slopes, expected, rtol=1e-4, atol=1e-6)


def test_both_are_one_least_squares_problem(run, points, fit):
    """Each residual over its deviation: of the recordings what their own residuals show."""
    alone = identify(Decay(1.0, 1.0), [run], plan=PLAN)
    left = errors([p.value for p in alone.parameters.values()], run)
    found = [p.value for p in fit.parameters.values()]

    def together(p):
        apart = points.channels["x"] - p[1] * points.channels["u"]
        return np.concatenate([errors(p, run) / left.std(), apart / SURE])

    expected = least_squares(together, [1.0, 1.0]).x
    assert abs(found[1] - expected[1]) < 0.2 * fit.horizon.ladder[0].std["gain"]
    assert fit.parameters["gain"].std < 0.5 * alone.parameters["gain"].std
    size = SURE / np.sqrt(np.sum(points.channels["u"] ** 2))
    known = 1 / np.hypot(1 / size, 1 / alone.horizon.ladder[0].std["gain"])
    assert fit.horizon.ladder[0].std["gain"] == pytest.approx(known, rel=0.15)


def test_recordings_and_points_weigh_as_their_noise_says(run):
    """Points as sure as the recordings, and apart from them: the estimate lies in the middle."""
    alone = identify(Decay(1.0, 1.0), [run], plan=PLAN)
    gain, of_run = alone.parameters["gain"].value, alone.horizon.ladder[0].std["gain"]
    apart = 2 * of_run
    one = SteadyPoints({"u": [1.0], "x": [gain + apart]}, {"x": of_run})
    both = identify(Start(Decay(1.0, 1.0), points=one), [run], plan=PLAN)
    assert (both.parameters["gain"].value - gain) / apart == pytest.approx(0.5, abs=0.08)


def test_a_point_is_compared_with_a_fit_without_it(run, points, fit, tmp_path):
    said = fit.stationary
    assert said.name == "bench"
    assert said.quantities == ("x",)
    for row in (0, 4):
        others = np.delete(np.arange(8), row)
        fewer = SteadyPoints({n: c[others] for n, c in points.channels.items()}, {"x": SURE})
        again = identify(Start(Decay(1.0, 1.0), points=fewer), [run], plan=PLAN)
        gain = again.parameters["gain"].value
        without = gain * points.channels["u"][row]
        assert said.without[row, 0] == pytest.approx(without, abs=0.1 * SURE)
        of_gain = again.horizon.ladder[0].std["gain"] * abs(points.channels["u"][row])
        assert said.deviation[row, 0] == pytest.approx(np.hypot(SURE, of_gain), rel=0.1)
    fit.save(tmp_path)
    np.testing.assert_array_equal(Fit.load(tmp_path).stationary.without, said.without)
    assert not fit.horizon.objections


def test_the_budget_has_a_row_of_points(run, points):
    sensed, x = np.random.default_rng(6), [0.0]
    for held in run.channels["u"][:-1]:
        x.append(held * GAIN + (x[-1] - held * GAIN) * np.exp(-RATE * STEP))
    measured = {**run.channels, "x": np.array(x) + NOISE * sensed.normal(size=400)}
    start = Start(Decay(1.0, 1.0), points=points)
    fit = identify(start, [replace(run, channels=measured)], plan=ladder_plan((5, 10, 20, 40)))
    assert fit.horizon.verdict == "plateau"
    rows = {row.source: row.std for row in fit.parameters["gain"].budget}
    size = SURE / np.sqrt(np.sum(points.channels["u"] ** 2))
    assert 0.5 * size < rows["priors and points at rest"] < size
    assert "prior of the learned map" not in rows


def test_points_that_contradict_are_an_objection(run, points):
    other = {**points.channels, "x": 1.3 * points.channels["x"]}
    fit = identify(Start(Decay(1.0, 1.0), points=replace(points, channels=other)), [run], plan=PLAN)
    assert "points contradict" in [one.name for one in fit.horizon.objections]


def test_outputs_at_rest_are_compared():
    inflow = np.array([0.2, 0.5, 0.9])
    pressure = 0.1 * (inflow / 0.4) ** 2 + 0.01 * inflow
    table = SteadyPoints({"inflow": inflow, "pressure": pressure}, {"pressure": 0.001})
    model = Tanks(0.5, 0.4)
    with float64():
        layout = Layout(model)
        values = layout.values(jnp.asarray(layout.raw(model)))
        gaps = table.penalty(model).gaps(layout, values)
    np.testing.assert_allclose(gaps, np.zeros((1, 3)), atol=1e-3)


class Moving(Decay):
    def derivative(self, x, u):
        return jnp.stack([self.rate * self.gain * u[0] + 0 * x[0]])


class Timed(Decay):
    def derivative(self, x, u, t):
        return jnp.stack([self.rate * (self.gain * u[0] - x[0]) + 0 * t])


NOISY = ExtendedKalman(Decay(1.0, 1.0), process=(0.1,), sensor=(0.1,))


@pytest.mark.parametrize(
    ("channels", "std", "words"),
    [
        ({"u": [1.0, 2.0], "x": [1.0]}, {"x": 1.0}, "columns of numbers of one length"),
        ({"u": [1.0], "x": [1.0]}, {}, "std must name a measured channel at least, got none"),
        ({"u": [1.0, 2.0], "x": [1.0, np.nan]}, {"x": 1.0}, "x is not finite in row 2"),
        ({"u": [1.0], "x": [1.0]}, {"x": 0.0}, "x must have std > 0"),
        ({"u": [1.0], "x": [1.0]}, {"y": 1.0}, "y has no column"),
        ({"u": ["off"], "x": [1.0]}, {"x": 1.0}, "columns of numbers"),
        ({"u": [1.0], "x": [1.0]}, {"x": [1.0, 2.0]}, "or such columns"),
    ],
)
def test_a_bad_table_is_refused(channels, std, words):
    with pytest.raises(InputError, match=words):
        SteadyPoints(channels, std)


@pytest.mark.parametrize(
    ("model", "channels", "words"),
    [
        (Decay(1.0, 1.0), {"x": [1.0]}, "the input u has no column"),
        (
            Moving(1.0, 1.0),
            {"u": [1.0], "x": [1.0]},
            "finds no state of rest at the point of row 1",
        ),
        (Timed(1.0, 1.0), {"u": [1.0], "x": [1.0]}, "time in its equation is never at rest"),
        (NOISY, {"u": [1.0], "x": [1.0]}, "noise on its states is never at rest"),
    ],
)
def test_a_model_that_is_never_at_rest_is_refused(run, model, channels, words):
    with pytest.raises(InputError, match=words):
        identify(Start(model, points=SteadyPoints(channels, {"x": 0.1})), [run], plan=PLAN)
