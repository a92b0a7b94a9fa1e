"""The forecast of the bias against what really happens to a ladder."""

from dataclasses import replace

import numpy as np
import pytest

from penode import Experiment, ladder_plan
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.loss_weighting import linearised, loss_weighting
from penode.paper.spectral import Spectral
from penode.training.loss import DEFAULT_LOSS, Loss
from penode.validation.free_run import compare

HORIZONS = (1, 4, 8, 16, 32, 64, 128)
PERIOD, SAMPLES = 16.0, 4000


def recording(system, disturbance, noise):
    """Simulate the twin with a disturbance (time, 2) in A a step, and noise in A on the sensors."""
    time = np.arange(SAMPLES) * system.time_step
    drive = np.stack(
        [6 * np.sin(37 * time), 8 * np.sin(29 * time + 1), np.full(SAMPLES, 300.0)], axis=1
    )
    states = [np.zeros(2)]
    for u, push in zip(drive[:-1], disturbance[:-1], strict=True):
        states.append(system.step("rk4", system.raw, states[-1], u) + push)
    seen = np.array(states) + noise * np.random.default_rng(2).normal(size=(SAMPLES, 2))
    names = (*system.model.states, *system.model.inputs)
    channels = dict(zip(names, np.column_stack([seen, drive]).T, strict=True))
    return Experiment("run.csv", system.time_step, channels)


def climb(system, run, loss=DEFAULT_LOSS):
    plan = replace(ladder_plan(HORIZONS), loss=loss)
    return LadderProblem.of(system.model, [run], plan, ignore_events).climb(plan, system.raw).fits


def errors(system, rungs):
    truth = system.raw.copy()
    truth[:2] = np.exp(truth[:2])
    return np.stack([rung.values[: len(truth)] - truth for rung in rungs])


@pytest.fixture(scope="module")
def machine(systems):
    return systems["linear machine"]


@pytest.fixture(scope="module")
def rippled(machine):
    turn = 2 * np.pi * np.arange(SAMPLES) / PERIOD
    ripple = 0.3 * np.stack([np.cos(turn), np.sin(turn + 0.4)], axis=1)
    run = recording(machine, ripple, 0.01)
    return run, climb(machine, run)


def test_lines_bias_as_forecast(machine, rippled):
    run, rungs = rippled
    forecast = Spectral([run]).forecast(rungs)
    happened = errors(machine, rungs)
    largest = np.abs(happened).max(axis=0)
    assert forecast.horizons == HORIZONS
    assert (np.abs(forecast.lines).max(axis=0) > 0.5 * largest).all()
    # The bias has a quadratic part too: a tenth of the inductance at the most.
    np.testing.assert_array_less(np.abs(forecast.lines - happened).max(axis=0), 0.35 * largest)


def test_noise_on_the_starts_biases_as_forecast(machine):
    run = recording(machine, np.zeros((SAMPLES, 2)), 0.6)
    rungs = climb(machine, run)
    forecast = Spectral([run], seed=1).forecast(rungs)
    at = 2  # R
    happened = np.array([rung.values[at] for rung in rungs]) - machine.raw[2]
    assert np.sign(forecast.starts[0, at]) == np.sign(happened[0])
    assert abs(forecast.starts[0, at] - happened[0]) < 0.5 * abs(happened[0])
    # The law of errors in variables: it falls with the horizon.
    assert abs(forecast.starts[-1, at]) < 0.2 * abs(forecast.starts[0, at])


def test_estimated_starts_take_up_what_the_loss_says(machine, rippled):
    run, _ = rippled
    loss = Loss(free_starts=dict.fromkeys(machine.model.states, 1.0))
    rungs = climb(machine, run, loss)
    happened = errors(machine, rungs)
    largest = np.abs(happened).max(axis=0)
    asked, as_measured = (Spectral([run], loss=one).forecast(rungs) for one in (loss, DEFAULT_LOSS))
    apart, wrong = (np.abs(f.lines - happened).max(axis=0) for f in (asked, as_measured))
    np.testing.assert_array_less(apart, 0.3 * largest)
    np.testing.assert_array_less(0.4 * largest, wrong)


def test_the_truth_is_chosen_by_how_the_loss_weighs_lines(machine, rippled):
    run, rungs = rippled
    freed = Loss(free_starts=dict.fromkeys(machine.model.states, 1.0))
    worst = [Spectral([run], loss=one)._worst(rungs) for one in (freed, DEFAULT_LOSS)]
    last = rungs[-1]
    matrices = linearised(last.predictor, last.model, run, np.ones(2))
    seen = compare(last.predictor, last.model, run)
    fractions = [
        sum(view.fractions(line) for line in view.lines)
        for starts in (np.ones(2), None)
        for view in [loss_weighting(seen, matrices, HORIZONS, starts=starts)]
    ]
    np.testing.assert_allclose(worst[0] - worst[1], np.log(fractions[0] / fractions[1]), atol=1e-9)
    assert np.abs(worst[0] - worst[1]).max() > 1e-4


class TowardsALargerResistance:
    def residuals(self, layout, values):
        return 0.3 * (values[2:3] - 1.0)


def test_what_a_penalty_does_alone_is_no_bias_of_the_lines(rippled):
    run, rungs = rippled
    penalised = Loss(penalties=(TowardsALargerResistance(),))
    found, plain = (Spectral([run], loss=one).forecast(rungs) for one in (penalised, DEFAULT_LOSS))
    at = 2  # R
    largest = np.abs(plain.lines[:, at]).max()
    np.testing.assert_allclose(found.lines[:, at], plain.lines[:, at], rtol=0, atol=0.2 * largest)


def test_a_horizon_that_lines_do_not_bias_is_chosen(machine, rippled):
    run, rungs = rippled
    choice = Spectral([run]).select(rungs)
    assert choice.index in choice.agreeing
    assert choice.verdict == "plateau"
    assert rungs[choice.index].horizon >= PERIOD
    error = [np.abs(r.values[:2] / np.exp(machine.raw[:2]) - 1).max() for r in rungs]
    assert error[choice.index] < 0.3 * error[0]
