"""Inputs that act late: the same as a recording with these inputs moved, in every predictor."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from tests.laws.test_every_predictor_and_model import PREDICTORS

import penode
from penode import Contiguous, Experiment, InputError, Model, Predictor, identify, physical
from penode.data.windows import cut
from penode.training.residuals import Objective
from penode.validation.free_run import compare

pytestmark = pytest.mark.usefixtures("quickly_compiled")

STEP, DELAY = 0.05, 0.17  # 3.4 samples


class Prompt(Model):
    """x' = -rate x + gain force + wind."""

    states: ClassVar = ("x",)
    inputs: ClassVar = ("wind", "force")
    state_units: ClassVar = ("m",)

    rate: object = physical("1/s")
    gain: object = physical("1/s")

    def derivative(self, x, u):
        return (-self.rate * x[0] + self.gain * u["force"] + u["wind"])[None]


class Late(Prompt):
    """The same, with a force that acts late."""

    dead_time: object = penode.delay("force", longest=1.0)


class Sensed(Late):
    """A sensor that shows the force too."""

    outputs: ClassVar = {"y": "m"}

    def output(self, x, u):
        return (x[0] + 0.2 * u["force"])[None]


def moved(force, samples):
    """Return a force so many samples later, before its first sample as there."""
    whole, part = int(samples), samples % 1
    at = np.arange(len(force))
    near, far = (force[np.maximum(at - whole - k, 0)] for k in range(2))
    return (1 - part) * near + part * far


def recordings(rng):
    """Return two recordings, and the same with the force as it acts."""
    made = [
        {"x": rng.normal(size=n), "force": rng.normal(size=n), "wind": rng.normal(size=n)}
        for n in (300, 260)
    ]
    acting = [{**one, "force": moved(one["force"], DELAY / STEP)} for one in made]
    return [[Experiment(f"r{k}", STEP, c) for k, c in enumerate(kind)] for kind in (made, acting)]


def terms_of(model, runs, predictor, reach=(0, 10_000)):
    """Return loss and Gauss-Newton terms of the windows that start within a range of samples."""
    options = {"past": predictor.past, "prepared": predictor.prepared, "placement": Contiguous()}
    windows = cut(runs, model.states, model.inputs, 7, **options)
    windows = windows.among((windows.starts >= reach[0]) & (windows.starts < reach[1]))
    objective = Objective(predictor, model, np.ones(1))
    return objective.gauss_newton(objective.layout.raw(model), windows)


#: Every predictor is checked by `make validate`; one of each kind by every `make test`.
QUICK = {
    "rk4",
    "ab2",
    "implicit midpoint",
    "sub-steps, straight input",
    "rk4, band-limited input",
}
NAMES = [pytest.param(n, marks=() if n in QUICK else pytest.mark.slow) for n in PREDICTORS]


@pytest.mark.parametrize("name", NAMES)
def test_a_delay_is_a_recording_whose_input_is_moved(name, rng):
    predictor, (made, acting) = Predictor(STEP, *PREDICTORS[name]), recordings(rng)
    # At an end the band-limited input through moved samples is another one.
    reach = (80, 220) if "band-limited" in name else (0, 10_000)
    late = terms_of(Late(2.0, 1.5, DELAY), made, predictor, reach)
    prompt = terms_of(Prompt(2.0, 1.5), acting, predictor, reach)
    assert late.loss == pytest.approx(prompt.loss, rel=1e-9)
    np.testing.assert_allclose(late.normal[:2, :2], prompt.normal, rtol=1e-8)
    if predictor.past > 1 or "band-limited" in name:
        return
    one, other = (
        compare(predictor, model, runs[1])
        for model, runs in ((Late(2.0, 1.5, DELAY), made), (Prompt(2.0, 1.5), acting))
    )
    np.testing.assert_allclose(one.one_step, other.one_step, atol=1e-12)
    np.testing.assert_allclose(one.free_run, other.free_run, atol=1e-12)


@pytest.mark.parametrize("name", ["rk4", "sub-steps, straight input"])
def test_the_slope_by_a_delay_is_that_of_differences(name, rng):
    predictor, (made, _) = Predictor(STEP, *PREDICTORS[name]), recordings(rng)
    losses = [
        terms_of(Late(2.0, 1.5, DELAY + shift), made, predictor) for shift in (-1e-5, 0.0, 1e-5)
    ]
    raw = [np.log(d / (1 - d)) for d in (DELAY - 1e-5, DELAY + 1e-5)]
    by_difference = (losses[2].loss - losses[0].loss) / (raw[1] - raw[0])
    gradient = -2 * losses[1].descent[2] / losses[1].count
    assert gradient == pytest.approx(by_difference, rel=1e-6)


def test_an_output_is_given_the_input_as_it_acts(rng):
    run = recordings(rng)[0][0]
    predictor, model = Predictor(STEP), Sensed(2.0, 1.5, DELAY)
    run = replace(run, channels={**run.channels, "y": run.channels["x"]})
    seen = compare(predictor, model, run)
    acting = moved(run.channels["force"], DELAY / STEP)
    state = replace(run, channels={**run.channels, "force": acting})
    alone = compare(predictor, Prompt(2.0, 1.5), replace(state, channels={**state.channels}))
    apart = seen.free_run[:, 0] - 0.2 * acting - alone.free_run[:, 0]
    decay = (seen.start[0] - alone.start[0]) * np.exp(-2.0 * STEP * np.arange(len(run)))
    np.testing.assert_allclose(apart, decay, atol=1e-5)


@pytest.fixture(scope="module")
def heated():
    """Return a first-order plant behind a dead time of 3.7 s, in closed form, with noise."""
    rng, step, count = np.random.default_rng(0), 0.5, 900
    power = rng.uniform(0, 10, 30).repeat(30)
    whole, part = int(3.7 / step), 3.7 / step % 1
    temperature = np.zeros(count)
    for k in range(count - 1):
        now = temperature[k]
        for length, back in ((part, whole + 1), (1 - part, whole)):
            end = 0.8 * power[max(k - back, 0)]
            now = end + (now - end) * np.exp(-length * step / 12.0)
        temperature[k + 1] = now
    channels = {"temperature": temperature + 0.02 * rng.normal(size=count), "power": power}
    return Experiment("run", step, channels)


class Heater(Model):
    states: ClassVar = ("temperature",)
    inputs: ClassVar = ("power",)
    state_units: ClassVar = ("K",)

    gain: object = physical("K/W")
    tau: object = physical("s")
    dead_time: object = penode.delay("power", longest=20.0)

    def derivative(self, x, u):
        return ((self.gain * u["power"] - x[0]) / self.tau)[None]


@pytest.mark.parametrize("start", [pytest.param(0.6, marks=pytest.mark.slow), 9.0])
def test_a_dead_time_is_estimated_from_far_off(heated, start):
    fit = identify(Heater(1.0, 8.0, start), [heated], plan=penode.ladder_plan((20, 60)))
    for name, truth in (("gain", 0.8), ("tau", 12.0), ("dead_time", 3.7)):
        low, high = fit.parameters[name].interval_95
        assert low < truth < high
        assert fit.parameters[name].value == pytest.approx(truth, rel=0.01)
    assert fit.parameters["dead_time"].unit == "s"


def test_what_delays_nothing_is_refused(heated):
    class Other(Heater):
        dead_time: object = penode.delay("powr", longest=1.0)

    with pytest.raises(InputError, match=r"delays powr, which is no input.*power"):
        identify(Other(1.0, 8.0, 0.5), [heated])
    with pytest.raises(InputError, match="the longest in s above zero"):
        penode.delay("power", longest=0.0)
    with pytest.raises(InputError, match="name the inputs it delays"):
        penode.delay(longest=1.0)
    with pytest.raises(InputError, match="dead_time"):
        identify(Heater(1.0, 8.0, 30.0), [heated])
