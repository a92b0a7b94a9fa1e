"""Unstable under feedback, or chaotic: no free run through a recording is to be expected of it."""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, Model, identify, physical
from penode.arrays import Leaf
from penode.engine import Positive
from penode.horizon import held_out_check, search
from penode.horizon.consensus import LEFT_OUT
from penode.horizon.held_out_check import unpredictable

STEP, RATE, GAIN, NOISE = 0.05, 1.0, 1.0, 0.01


class Unstable(Model):
    """x' = a x + b u."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    a: Leaf = physical("1/s")
    b: Leaf = physical("1/s")

    def derivative(self, x, u):
        return self.a * x + self.b * u[0][None]


def recorded(seed, cubic=0.0, samples=300):
    """Return a recording of fifteen time constants, the loop closed through u = -3 x + w."""
    random = np.random.default_rng(seed)
    x, u, grown = np.zeros(samples), np.zeros(samples), np.exp(RATE * STEP)
    command = np.repeat(random.normal(0, 1, samples // 10), 10)
    for k in range(samples):
        u[k] = -3 * x[k] + command[k]
        if k + 1 < samples:
            pushed = GAIN * u[k] - cubic * x[k] ** 3
            x[k + 1] = x[k] * grown + pushed * (grown - 1) / RATE
    noisy = x + NOISE * random.normal(size=samples)
    return Experiment(f"run {seed}", STEP, {"x": noisy, "u": u})


@pytest.fixture(scope="module")
def fit():
    return identify(Unstable(0.5, 0.7), [recorded(4)], validation=[recorded(5)])


def test_a_right_model_is_not_blamed_for_a_free_run_that_grows(fit):
    """Free runs err by ten thousand times what the state moves, windows by the noise."""
    assert not fit.comparisons[0].free_run_errors["x"] < 1e3
    assert fit.horizon.verdict == "plateau"
    assert fit.horizon.objections == ()
    for name, truth in (("a", RATE), ("b", GAIN)):
        low, high = fit.parameters[name].interval_95
        assert low < truth < high
        assert high - low < 0.1 * truth


@pytest.mark.parametrize(("seed", "agrees"), [(3, False), (2, True), (4, True)])
def test_what_the_model_leaves_out_is_an_objection_or_in_the_interval(seed, agrees):
    """A cubic spring moves a by more than a where horizons agree; deviations count it there."""
    found = identify(Unstable(0.5, 0.7), [recorded(seed, cubic=20.0)])
    assert (found.horizon.verdict in ("plateau", "H = 1 suffices")) == agrees
    for name, truth in (("a", RATE), ("b", GAIN)):
        low, high = found.parameters[name].interval_95
        assert low < truth < high
    assert found.parameters["a"].budget[0].source == LEFT_OUT
    assert found.parameters["a"].std > 1.0
    assert "is what the model leaves out" in str(found)


def test_it_takes_known_parameters_and_windows_that_are_explained(fit):
    run, moves = [recorded(4)], np.array([0.3])
    assert unpredictable(fit, moves, run)
    assert not unpredictable(fit, 1e9 * moves, run)
    unknown = replace(fit, covariance=np.full((2, 2), np.inf))
    assert not unpredictable(unknown, moves, run)
    ladder, selected = fit.horizon.ladder, fit.horizon.selected
    for rungs in (
        [replace(one, rmse=0.08) for one in ladder],
        [replace(one, rmse=one.rmse * (1.3 if one.horizon == selected else 1)) for one in ladder],
        [one for one in ladder if one.horizon == selected],
    ):
        horizon = replace(fit.horizon, ladder=tuple(rungs))
        assert not unpredictable(replace(fit, horizon=horizon), moves, run)
    beyond = [replace(one, rmse=1.0 if one.horizon > selected else one.rmse) for one in ladder]
    horizon = replace(fit.horizon, ladder=tuple(beyond))
    assert unpredictable(replace(fit, horizon=horizon), moves, run)


@pytest.mark.parametrize("last", [np.nan, np.inf, 1e200])
def test_a_deviation_may_grow_beyond_any_number(fit, monkeypatch, last):
    astray = np.full((1, 1), np.inf)
    monkeypatch.setattr(held_out_check, "free_run_errors", lambda *given: astray)
    bands = np.array([[0.0], [last]])
    monkeypatch.setattr(type(fit), "free_run_deviation", lambda self, run: bands)
    assert unpredictable(fit, np.array([0.3]), [recorded(4)])
    monkeypatch.setattr(type(fit), "free_run_deviation", lambda self, run: 0 * bands[:1])
    assert not unpredictable(fit, np.array([0.3]), [recorded(4)])


@pytest.mark.parametrize(("units", "explained"), [(("m", "m"), False), (("m", "m/s"), True)])
def test_errors_of_unlike_units_are_in_deviations_of_the_channels(fit, units, explained):
    """0.009 m is far beyond a quarter of a state's move of 1 mm; 0.009 deviations are not."""
    alike = replace(fit, comparisons=(replace(fit.comparisons[0], units=units),))
    assert unpredictable(alike, np.array([1e-3]), [recorded(4)]) == explained


def test_a_plateau_is_refused_only_by_free_runs_whose_start_is_estimated(monkeypatch):
    """From the noise of the first sample unstable motion departs, with any parameters."""
    asked, free_runs = [], search.with_free_runs

    def noted(problem, climb, free=None):
        asked.append(free)
        return free_runs(problem, climb, free)

    monkeypatch.setattr(search, "with_free_runs", noted)
    assert identify(Unstable(0.5, 0.7), [recorded(8)]).horizon.verdict == "plateau"
    assert asked[-1] == ("x",)


class Pendulum(Model):
    """angle'' = gain torque - damping angle' - w2 sin(angle)."""

    states: ClassVar[tuple[str, ...]] = ("angle", "speed")
    inputs: ClassVar[tuple[str, ...]] = ("torque",)
    state_units: ClassVar[tuple[str, ...]] = ("rad", "rad/s")

    w2: Leaf = physical("1/s2", Positive())
    damping: Leaf = physical("1/s", Positive())
    gain: Leaf = physical("1/(kg m2)", Positive())

    def derivative(self, x, u):
        turned = self.gain * u[0] - self.damping * x[1] - self.w2 * jnp.sin(x[0])
        return jnp.stack([x[1], turned])


def tumbling(seed, samples=600, step=0.02):
    """Return a recording of a pendulum that goes over the top: chaotic motion, 2 % noise."""
    random = np.random.default_rng(seed)
    torque = np.repeat(random.uniform(-3, 3, samples // 30), 30)
    x, h = np.zeros((samples, 2)), step / 4

    def rate(x, torque):
        return np.array([x[1], 10 * torque - 0.4 * x[1] - 24 * np.sin(x[0])])

    for k in range(samples - 1):
        y = x[k]
        for _ in range(4):
            a = rate(y, torque[k])
            b = rate(y + h / 2 * a, torque[k])
            c = rate(y + h / 2 * b, torque[k])
            y = y + h / 6 * (a + 2 * b + 2 * c + rate(y + h * c, torque[k]))
        x[k + 1] = y
    x = x + 0.02 * x.std(axis=0) * random.normal(size=x.shape)
    return Experiment("swing", step, {"angle": x[:, 0], "speed": x[:, 1], "torque": torque})


@pytest.mark.parametrize("seed", [1, 7])
def test_chaotic_motion_is_blamed_neither_on_the_solver_nor_on_the_model(seed):
    """Starts of windows have many minima: two solvers are compared in the same ones."""
    found = identify(Pendulum(15.0, 0.6, 7.0), [tumbling(seed)])
    assert found.horizon.verdict == "plateau"
    assert found.horizon.objections == ()
    for name, truth in (("w2", 24.0), ("damping", 0.4), ("gain", 10.0)):
        low, high = found.parameters[name].interval_95
        assert low < truth < high
        assert high - low < 0.1 * truth
