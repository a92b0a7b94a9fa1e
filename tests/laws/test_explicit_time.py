"""Time in an equation: every predictor has at every stage the t that a clock as a state would have.

The clock is a state of rate 1 that no solver gets wrong; beside it stand closed forms.
"""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from tests.laws.test_every_predictor_and_model import PREDICTORS

from penode import Contiguous, Experiment, Model, Predictor, identify, ladder_plan, physical
from penode.data.stretches import with_reason
from penode.data.windows import cut
from penode.models.explicit_time import driving_channels
from penode.predictors.holds import FirstOrderHold, ZeroOrderHold
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import DOPRI5, RK4
from penode.training.residuals import Objective
from penode.validation.free_run import compare

pytestmark = pytest.mark.usefixtures("quickly_compiled")

RATE, GAIN, SPEED = 2.0, 3.0, 5.0


class Driven(Model):
    """x' = -rate x + force + gain cos(speed t)."""

    states: ClassVar = ("x",)
    inputs: ClassVar = ("force",)
    state_units: ClassVar = ("m",)

    rate: object = physical("1/s")
    gain: object = physical("m/s")
    speed: object = physical("rad/s")

    def derivative(self, x, u, t):
        (force,) = u
        return (-self.rate * x[0] + force + self.gain * jnp.cos(self.speed * t))[None]


class WithClock(Driven):
    """The same with a state that is the time."""

    states: ClassVar = ("x", "clock")
    state_units: ClassVar = ("m", "m")

    def derivative(self, x, u):
        return jnp.stack([Driven.derivative(self, x, u, x[1])[0], 0.0 * x[1] + 1.0])


def solution(t, start, force=0.0):
    """Return the closed form of a constant force from x(0) = start."""
    size = GAIN / (RATE**2 + SPEED**2)
    forced = size * (RATE * np.cos(SPEED * t) + SPEED * np.sin(SPEED * t)) + force / RATE
    return forced + (start - size * RATE - force / RATE) * np.exp(-RATE * t)


def recorded(step=0.01, count=400):
    """Return what is measured of the closed form without force."""
    t = step * np.arange(count)
    return Experiment("run", step, {"x": solution(t, 0.4), "force": np.zeros(count)})


def predicted(model, run, predictor, horizon):
    """Return the loss and Gauss-Newton terms of windows of a recording."""
    options = {"past": predictor.past, "prepared": predictor.prepared, "placement": Contiguous()}
    windows = cut([run], model.states, driving_channels(model), horizon, **options)
    objective = Objective(predictor, model, np.ones(len(model.states)))
    return objective.gauss_newton(objective.layout.raw(model), windows)


@pytest.mark.parametrize("name", PREDICTORS)
def test_time_is_what_a_clock_as_a_state_shows(name, rng):
    run = recorded(0.05)
    force = {"force": rng.normal(size=len(run))}
    run = replace(run, channels={**run.channels, **force, "clock": run.times})
    predictor = Predictor(run.time_step, *PREDICTORS[name])
    given = (RATE, GAIN, SPEED)
    one, two = (predicted(model(*given), run, predictor, 7) for model in (Driven, WithClock))
    assert one.loss == pytest.approx(2 * two.loss, rel=1e-10)  # of which the clock's half is zero
    scale = np.sqrt(np.outer(np.diag(two.normal), np.diag(two.normal)))
    assert np.abs((one.normal - two.normal) / scale).max() < 1e-10


@pytest.mark.parametrize(
    ("solver", "hold"),
    [
        (RungeKutta(DOPRI5), ZeroOrderHold()),
        (Substeps(RungeKutta(RK4), 4), FirstOrderHold()),
    ],
)
def test_a_free_run_is_the_closed_form(solver, hold):
    run = recorded()
    predictor = Predictor(run.time_step, solver, hold)
    seen = compare(predictor, Driven(RATE, GAIN, SPEED), run)
    assert np.abs(seen.free_run - seen.measured).max() < 1e-8
    # A part of it goes on with its own time, as does what a gap in time has cut off.
    part = run.part(130, 300)
    seen = compare(predictor, Driven(RATE, GAIN, SPEED), part)
    assert np.abs(seen.free_run - seen.measured).max() < 1e-8
    assert np.allclose(with_reason(part, "A sentence.").times, run.times[130:300], atol=1e-14)
    shifted = replace(part, stretch=None)
    seen = compare(predictor, Driven(RATE, GAIN, SPEED), shifted)
    assert np.abs(seen.free_run - seen.measured).max() > 0.01


class Sensor(Driven):
    """A sensor of which the zero drifts along."""

    outputs: ClassVar = {"y": "m"}

    drift: object = physical("m/s")

    def output(self, x, u, t):
        return (x[0] + self.drift * t)[None]


def test_an_output_may_take_time_too():
    run = recorded()
    run = Experiment(
        "run", run.time_step, {**run.channels, "y": run.channels["x"] + 0.3 * run.times}
    )
    parts = [run.part(0, 150), run.part(220, 400)]
    start = Sensor(rate=1.5, gain=2.0, speed=5.2, drift=0.0)
    fit = identify(start, parts, plan=ladder_plan((10, 30)))
    truth = {"rate": RATE, "gain": GAIN, "speed": SPEED, "drift": 0.3}
    found = {name: one.value for name, one in fit.parameters.items()}
    assert found == pytest.approx(truth, rel=1e-5)


def test_the_default_plan_takes_it(rng):
    """The training, its checks of hold and solver, and what is left out by the model."""
    run, force = recorded(count=1500), rng.normal(size=50).repeat(30)
    run = replace(run, channels={**run.channels, "force": force})
    truth = Predictor(run.time_step, RungeKutta(DOPRI5)), Driven(RATE, GAIN, SPEED)
    noisy = compare(*truth, run).free_run[:, 0] + 0.001 * rng.normal(size=len(run))
    run = replace(run, channels={"x": noisy, "force": force})
    fit = identify(Driven(1.5, 2.0, 5.2), [run.part(0, 700), run.part(720, 1500)])
    assert fit.horizon.verdict == "plateau"
    for name, true in (("rate", RATE), ("gain", GAIN), ("speed", SPEED)):
        low, high = fit.parameters[name].interval_95
        assert low < true < high
