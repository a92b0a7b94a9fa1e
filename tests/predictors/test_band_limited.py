"""The band-limited hold against multisines in closed form, in everything that predicts."""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Contiguous, Experiment, InputError, Model, Predictor, physical
from penode.arrays import float64
from penode.data.windows import cut
from penode.horizon.loss_weighting import linearised
from penode.models.inputs import Inputs
from penode.pmsm.machine.holds import HOLDS
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.holds import FirstOrderHold, ZeroOrderHold
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.input_table import Substep
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import AB3, DOPRI5, EULER, RK4, RK4_38
from penode.training.chunks import _sum_over_chunks
from penode.training.residuals import Objective
from penode.validation.free_run import compare, free_run_errors

PLACES, ACCURACY, SIDE = (0.25, 0.5, 0.9), 1e-9, 64


def multisine(lines, top, seed=3):
    """Return a signal of the time in samples, all lines below a part of the Nyquist frequency."""
    random = np.random.default_rng(seed)
    frequency = np.pi * random.uniform(0.0, top, lines)
    phase, size = random.uniform(0, 2 * np.pi, lines), random.normal(size=lines)
    return lambda t: 0.7 + np.cos(np.multiply.outer(t, frequency) + phase) @ size / np.sqrt(lines)


def errors(signal, samples):
    """Return what the hold errs by, (time, place), over the deviation of the signal."""
    k = np.arange(float(samples))
    found = BandLimitedHold().between(signal(k)[:, None], (0.0, *PLACES))[:, :, 0]
    np.testing.assert_array_equal(found[:, 0], signal(k))
    truth = signal(k[:, None] + np.array(PLACES))
    return np.abs(found[:, 1:] - truth)[:-1] / signal(k).std()


@pytest.mark.parametrize(("lines", "top"), [(30, 0.3), (400, 0.8), (400, 0.87)])
def test_the_interior_of_a_recording_is_exact_below_0_88_of_nyquist(lines, top):
    assert errors(multisine(lines, top), 1200)[SIDE:-SIDE].max() < ACCURACY


@pytest.mark.parametrize(("lines", "top"), [(5, 0.3), (20, 0.8), (40, 0.85)])
def test_a_multisine_of_few_lines_is_exact_to_the_ends(lines, top):
    assert errors(multisine(lines, top), 1200).max() < ACCURACY


def test_above_nyquist_nothing_is_exact():
    assert errors(lambda t: np.cos(1.2 * np.pi * t), 1200).max() > 0.1


def test_the_ends_of_an_oversampled_input_are_good_and_those_of_a_short_one_smooth():
    assert errors(multisine(200, 0.3), 1200).max() < 1e-6
    assert errors(multisine(3, 0.05), 100).max() < 3e-3


def test_a_constant_stays_one_to_rounding():
    for samples in (1, 2, 40, 400):
        found = BandLimitedHold().between(np.full((samples, 2), 3.0), PLACES)
        np.testing.assert_allclose(found, 3.0, rtol=1e-14)


THIRDS = {
    "rk4": (RungeKutta(RK4), (0, 1 / 2, 1)),
    "euler": (RungeKutta(EULER), (0,)),
    "3/8": (RungeKutta(RK4_38), (0, 1 / 3, 2 / 3, 1)),
    "dopri5": (RungeKutta(DOPRI5), (0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1)),
    "sub-steps": (Substeps(RungeKutta(RK4), 3), (0, 1 / 2, 1)),
    "midpoint": (ImplicitMidpoint(), (0, 1 / 2)),
    "trapezoidal": (Trapezoidal(), (0, 1)),
}


@pytest.mark.parametrize("name", THIRDS)
def test_a_table_has_the_places_that_a_solver_reads_in_each_of_its_sub_steps(name):
    solver, places = THIRDS[name]
    predictor = Predictor(0.1, solver, BandLimitedHold())
    assert predictor.table.places == pytest.approx(places, abs=1e-11)
    count = predictor.table.count
    inputs = np.random.default_rng(1).normal(size=(300, 2))
    rows = predictor.prepared(inputs).reshape(300, count, len(places), 2)
    for number in range(count):
        within = [(number + place) / count for place in places]
        np.testing.assert_array_equal(rows[:, number], BandLimitedHold().between(inputs, within))


def test_a_multistep_solver_reads_samples_alone():
    predictor = Predictor(0.1, AdamsBashforth(AB3), BandLimitedHold())
    assert predictor.table is None
    assert len(predictor.prepared(np.ones((4, 1)))) == 4


def test_one_program_serves_every_recorded_hold_and_every_number_of_sub_steps():
    """And no other solver, step or hold of one's own."""
    one = Predictor(0.1, Substeps(RungeKutta(RK4), 1), BandLimitedHold())
    for count in (2, 16):
        for hold in (ZeroOrderHold(), FirstOrderHold(), BandLimitedHold()):
            assert Predictor(0.1, Substeps(RungeKutta(RK4), count), hold).program == one.program
    assert Predictor(0.2, one.solver, one.hold).program != one.program
    assert Predictor(0.1, Substeps(RungeKutta(EULER), 1), one.hold).program != one.program
    assert Predictor(0.1, one.solver, HOLDS["stationary"]).program != one.program


@pytest.mark.usefixtures("quickly_compiled")
def test_what_differs_in_hold_and_sub_steps_is_not_compiled_again(runs):
    """And a step of each is what the predictor alone predicts."""
    (run, _), losses, compiled = runs[0], [], []
    for count in (1, 2, 5):
        for hold in (ZeroOrderHold(), FirstOrderHold(), BandLimitedHold()):
            predictor = Predictor(STEP, Substeps(RungeKutta(EULER), count), hold)
            objective = Objective(predictor, MODEL, np.ones(1))
            windows = cut(
                [run],
                MODEL.states,
                MODEL.inputs,
                1,
                placement=Contiguous(),
                prepared=predictor.prepared,
            )
            losses.append(objective.gauss_newton(objective.layout.raw(MODEL), windows).loss)
            compiled.append(_sum_over_chunks._cache_size())
            gap = run.channels["x"][1:] - compare(predictor, MODEL, run).one_step[1:, 0]
            assert losses[-1] == pytest.approx(np.mean(gap**2), rel=1e-9)
    assert len(set(compiled)) == 1
    assert len(set(losses)) == 1 + 6  # one Euler step reads the sample alone, whatever the hold


def test_a_place_between_samples_is_refused_without_the_recording():
    with pytest.raises(InputError, match="predict by a Predictor, which interpolates it once"):
        BandLimitedHold()(lambda k: Inputs(np.zeros((1, 1)), ("u",)), 0, 0.5, 1.0)


# --- in all that predicts -----------------------------------------------------------------------


class Leak(Model):
    """x' = -rate u x, so that each step multiplies by the exponential of an integral of u."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("V",)

    rate: object = physical("1/s")

    def derivative(self, x, u):
        return -self.rate * u[0] * x


STEP, RATE = 0.5, 0.2


def leaking(samples, seed):
    """Return a recording in closed form, and its factors (time - 1,) from sample to sample."""
    random = np.random.default_rng(seed)
    frequency, phase = np.pi * random.uniform(0.1, 0.4, 10), random.uniform(0, 2 * np.pi, 10)
    k = np.arange(float(samples))
    u = 0.2 * np.cos(np.outer(k, frequency) + phase).sum(axis=1)
    x = np.exp(
        -0.2 * RATE * STEP * (np.sin(np.outer(k, frequency) + phase) / frequency).sum(axis=1)
    )
    return Experiment(f"run{seed}", STEP, {"u": u, "x": x}), x[1:] / x[:-1]


@pytest.fixture(scope="module")
def runs():
    return [leaking(600, 1), leaking(500, 2)]


MODEL = Leak(RATE)
PREDICTOR = Predictor(STEP, Substeps(RungeKutta(DOPRI5), 5), BandLimitedHold())


@pytest.mark.usefixtures("quickly_compiled")
def test_single_steps_free_runs_and_their_linearisation_are_the_closed_form(runs):
    run, factor = runs[0]
    seen = compare(PREDICTOR, MODEL, run)
    x = run.channels["x"]
    np.testing.assert_allclose(seen.one_step[1:, 0], factor * x[:-1], rtol=ACCURACY)
    np.testing.assert_allclose(seen.free_run[:, 0], x, rtol=100 * ACCURACY)
    assert free_run_errors(PREDICTOR, [[MODEL]], [run])[0, 0] < 100 * ACCURACY * x.max()
    matrices = linearised(PREDICTOR, MODEL, run, np.ones(1))[:, 0, 0]
    at = np.unique(np.linspace(0, len(run) - 2, 64).round().astype(int))
    np.testing.assert_allclose(matrices, factor[at], rtol=ACCURACY)


@pytest.mark.usefixtures("quickly_compiled")
def test_training_errs_by_the_solver_alone_in_all_windows_of_each_recording(runs):
    """The recordings are interpolated each by itself, not over the seam."""
    both, predictor = [run for run, _ in runs], replace(PREDICTOR, solver=RungeKutta(DOPRI5))
    named = MODEL.states, MODEL.inputs
    windows = cut(both, *named, 9, placement=Contiguous(), prepared=predictor.prepared)
    objective = Objective(predictor, MODEL, np.ones(1))
    terms = objective.gauss_newton(objective.layout.raw(MODEL), windows)
    assert terms.loss < 3e-5**2 * np.mean(windows.states**2)


class Turning(Model):
    """An angle that goes on at its rate, and a voltage beside it."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("angle", "rate", "u")
    state_units: ClassVar[tuple[str, ...]] = ("V",)
    input_rates: ClassVar[dict[str, str]] = {"angle": "rate"}

    def derivative(self, x, u):
        return u["u"][None]


def test_inputs_that_have_a_rate_go_on_at_it():
    """Angles that wrap are no band-limited signal."""
    signal, k = multisine(10, 0.5), np.arange(600.0)
    inputs = np.stack([(0.7 * k) % (2 * np.pi), np.full(600, 0.7 / STEP), signal(k)], axis=1)
    predictor = Predictor(STEP, Substeps(DEFAULT_SOLVER, 2), BandLimitedHold())
    row = predictor.prepared(inputs)[300].reshape(2, 3, 3)[1, 1]
    with float64():
        part = Substep(1, 2, jnp.asarray(inputs[300][:, None]), STEP)
        read = part.moved_on(Inputs(jnp.asarray(row[:, None]), Turning.inputs), Turning(), 0.5)
    assert float(read["angle"][0]) == pytest.approx(inputs[300, 0] + 0.75 * 0.7, rel=1e-14)
    assert float(read["u"][0]) == pytest.approx(signal(300.75), rel=ACCURACY)
