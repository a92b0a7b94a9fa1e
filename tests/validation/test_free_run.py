"""One-step predictions and free runs against a NumPy loop."""

from dataclasses import replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, InputError, Model, Predictor, physical
from penode.arrays import Leaf, float64
from penode.models.parameters import with_batch_axis
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import AB3, EULER
from penode.validation import free_run
from penode.validation.comparison import Comparison
from penode.validation.free_run import compare, free_run_errors
from penode.validation.look_ahead import look_ahead, look_far_ahead


def predictor_of(system):
    return Predictor(system.time_step)


@pytest.mark.parametrize("name", ["duffing", "linear machine"])
def test_predictions_are_those_of_the_numpy_twin(systems, name):
    system = systems[name]
    run = system.experiments[1]
    found = compare(predictor_of(system), system.model, run, "validation")
    measured, inputs = run.stack(system.model.states), run.stack(system.model.inputs)
    ahead = system.step("rk4", system.raw[:, None], measured[:-1].T, inputs[:-1].T).T
    free = system.simulate(measured[0], inputs)
    np.testing.assert_array_equal(found.measured, measured)
    np.testing.assert_array_equal(found.one_step[0], measured[0])
    np.testing.assert_allclose(found.one_step[1:], ahead, rtol=0, atol=1e-12 * np.abs(ahead).max())
    np.testing.assert_allclose(found.free_run, free, rtol=0, atol=1e-12 * np.abs(free).max())
    for k, state in enumerate(system.model.states):
        one_step, whole = (ahead - measured[1:])[:, k], (free - measured)[1:, k]
        assert found.one_step_errors[state] == pytest.approx(np.sqrt(np.mean(one_step**2)))
        assert found.free_run_errors[state] == pytest.approx(np.sqrt(np.mean(whole**2)))
    assert (found.name, found.role, found.time_step) == (run.name, "validation", run.time_step)
    assert (found.states, found.units) == (system.model.states, system.model.state_units)


def test_the_solver_is_the_predictors(systems):
    system = systems["duffing"]
    run = system.experiments[1]
    found = compare(Predictor(system.time_step, RungeKutta(EULER)), system.model, run, "train")
    measured, inputs = run.stack(system.model.states), run.stack(system.model.inputs)
    ahead = system.step("euler", system.raw[:, None], measured[:-1].T, inputs[:-1].T).T
    np.testing.assert_allclose(found.one_step[1:], ahead, rtol=0, atol=1e-12)


def test_a_free_run_that_diverges_has_an_infinite_error(systems):
    system = systems["linear machine"]
    unstable = replace(system.model, R=np.array(-200.0))
    run = system.experiments[1]
    found = compare(predictor_of(system), unstable, run, "train")
    assert found.free_run_rmse == np.inf
    assert found.diverged
    assert np.isfinite(found.one_step_rmse)
    both = free_run_errors(predictor_of(system), [[system.model] * 2, [unstable] * 2], [run, run])
    assert np.isfinite(both[0]).all()
    assert (both[1] == np.inf).all()


def test_free_run_error_weighs_recordings_by_their_length(systems):
    system = systems["linear machine"]
    runs = system.experiments
    parts = [compare(predictor_of(system), system.model, run, "train") for run in runs]
    errors = np.concatenate([(p.measured - p.free_run)[1:] for p in parts])
    found = free_run_errors(predictor_of(system), [[system.model] * len(runs)], runs)
    np.testing.assert_allclose(found[0], np.sqrt(np.mean(errors**2, axis=0)), rtol=1e-12)


def test_errors_are_pooled_over_states_of_one_unit_alone(systems):
    """Amperes and amperes make a root mean square; metres and metres per second make none."""
    zeros, apart = np.zeros((3, 2)), np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0]])
    alike = Comparison("run", "train", 1.0, ("i_d", "i_q"), ("A", "A"), zeros, apart, apart)
    assert alike.one_step_errors == {"i_d": 3.0, "i_q": 4.0}
    assert (alike.unit, alike.one_step_rmse) == ("A", pytest.approx(np.sqrt(12.5)))
    mixed = replace(alike, units=("m", "m/s"))
    assert mixed.free_run_errors == {"i_d": 3.0, "i_q": 4.0}
    assert mixed.unit is None
    assert np.isnan([mixed.one_step_rmse, mixed.free_run_rmse]).all()
    assert not mixed.diverged


def test_a_free_run_a_thousand_times_as_large_has_diverged():
    """Of states in one unit the largest counts."""
    measured = np.array([[1.0, 0.01], [-2.0, 0.01], [2.0, 0.0]])
    run = Comparison("run", "train", 1.0, ("i_d", "i_q"), ("A", "A"), measured, measured, measured)
    for times, diverged in ((1.9e3, False), (2.1e3, True)):
        far = replace(run, free_run=measured + np.array([0.0, times]))
        assert far.diverged == diverged
        assert far.free_run_errors["i_q"] == (np.inf if diverged else pytest.approx(times))
        assert far.free_run_rmse == (np.inf if diverged else pytest.approx(times / np.sqrt(2)))
    assert replace(run, units=("A", "rad/s"), free_run=measured + np.array([0.0, 11.0])).diverged


def test_a_missing_channel_is_named(systems):
    system = systems["linear machine"]
    run = Experiment("half.csv", 1e-4, {"i_d": np.zeros(9), "i_q": np.zeros(9), "u_d": np.zeros(9)})
    with pytest.raises(InputError, match=r"half\.csv: no channel u_q, omega_el"):
        compare(predictor_of(system), system.model, run, "train")


def test_errors_leave_the_measured_start_out():
    zeros = np.zeros((3, 1))
    wrong_start = np.array([[9.0], [2.0], [2.0]])
    found = Comparison("run", "train", 1.0, ("x",), ("m",), zeros, wrong_start, wrong_start)
    assert (found.one_step_rmse, found.free_run_rmse) == (2.0, 2.0)


# --- looking k samples ahead ------------------------------------------------------------------


def looked_ahead(predictor, system, run, steps, look=look_ahead):
    """Return the samples (time, state) from `past` on."""
    with float64():
        columns = (run.stack(n).T for n in (system.model.states, system.model.inputs))
        states, inputs = (jnp.asarray(c) for c in columns)
        model = with_batch_axis(system.model)
        return np.asarray(look(predictor, model, states, inputs, steps)).T


def plainly_ahead(system, run, origin_of):
    """Return what a loop predicts of each sample but the first, from an origin before it."""
    measured, inputs = run.stack(system.model.states), run.stack(system.model.inputs)
    expected = []
    for target in range(1, len(run)):
        origin = origin_of(target)
        x = measured[origin]
        for u in inputs[origin:target]:
            x = system.step("rk4", system.raw, x, u)
        expected.append(x)
    return expected


@pytest.mark.parametrize("steps", [1, 2, 5, 200])
def test_looking_ahead_is_the_plain_loop(systems, steps):
    """From k samples before, or from the first one where there are fewer: then a free run."""
    system = systems["duffing"]
    run = system.experiments[1].part(0, 60)
    expected = plainly_ahead(system, run, lambda target: max(target - steps, 0))
    found = looked_ahead(predictor_of(system), system, run, steps)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("least", [1, 2, 7, 50, 200])
def test_looking_far_ahead_is_the_plain_loop(systems, least):
    """Windows start `least` samples apart; each gives what lies between that and twice as far."""
    system = systems["duffing"]
    run = system.experiments[1].part(0, 60)
    expected = plainly_ahead(system, run, lambda target: max((target - 1) // least - 1, 0) * least)
    found = looked_ahead(predictor_of(system), system, run, least, look_far_ahead)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(("steps", "which"), [(1, "one_step"), (200, "free_run")])
def test_one_step_and_free_run_are_its_ends(systems, steps, which):
    """With a solver that starts from three samples."""
    system = systems["duffing"]
    run, predictor = system.experiments[1], Predictor(system.time_step, AdamsBashforth(AB3))
    expected = getattr(compare(predictor, system.model, run), which)
    found = looked_ahead(predictor, system, run, steps)
    assert len(found) == len(run) - 3
    np.testing.assert_allclose(found, expected[3:], rtol=0, atol=1e-11)


# --- an estimated start -----------------------------------------------------------------------


class Hidden(Model):
    """x'' = u - 2 x - 0.4 x', the speed without a sensor."""

    states: ClassVar[tuple[str, ...]] = ("x", "v")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s")
    unmeasured: ClassVar[tuple[str, ...]] = ("v",)

    k: Leaf = physical("1/s2")

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - 0.4 * x[1]])


class Seen(Hidden):
    """The same with a sensor."""

    unmeasured: ClassVar[tuple[str, ...]] = ()


class Escaping(Seen):
    """x' = k (1 + x^2), a tangent: gone to infinity in no time, wherever it starts."""

    def derivative(self, x, u):
        return jnp.stack([self.k * (1 + x[0] ** 2), 0 * x[1]])


STEP, START = 0.1, np.array([0.6, -1.1])


def recorded(**wrong):
    """Record x, v and u of the twin from START; `wrong` is added to the first sample."""
    u, path = np.sin(0.13 * np.arange(80)), [START]
    for push in u[:-1]:

        def derivative(z, push=push):
            return np.array([z[1], push - 2.0 * z[0] - 0.4 * z[1]])

        x = path[-1]
        k1 = derivative(x)
        k2 = derivative(x + STEP / 2 * k1)
        k3 = derivative(x + STEP / 2 * k2)
        k4 = derivative(x + STEP * k3)
        path.append(x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    x, v = np.array(path).T
    channels = {"x": x, "v": v, "u": u}
    for name, error in wrong.items():
        channels[name] = channels[name].copy()
        channels[name][0] += error
    return Experiment("run.csv", STEP, channels), np.array(path)


def without_speed(run):
    return Experiment(run.name, STEP, {n: c for n, c in run.channels.items() if n != "v"})


@pytest.mark.parametrize("free", [("x",), ("v", "x")])
def test_a_wrong_first_sample_is_estimated_away(free):
    run, truth = recorded(x=0.3)
    found = compare(Predictor(STEP), Seen(2.0), run, free=free)
    np.testing.assert_allclose(found.free_run, truth, rtol=0, atol=1e-8)
    held = compare(Predictor(STEP), Seen(2.0), run)
    np.testing.assert_array_equal(held.free_run[0], run.stack(("x", "v"))[0])
    assert max(held.free_run_errors.values()) > 0.05


@pytest.mark.filterwarnings("error")
def test_a_free_run_that_diverges_from_every_start_has_an_infinite_error():
    run, _ = recorded()
    found = compare(Predictor(STEP), Escaping(50.0), run, free=("x", "v"))
    assert found.free_run_errors["x"] == np.inf


def test_what_estimates_starts_is_compiled_once(caplog):
    run, _ = recorded()
    shorter = recorded(x=0.1)[0].part(0, 70)
    errors = [compare(Predictor(STEP), Hidden(2.0), without_speed(run)).free_run_rmse]
    with jax.log_compiles(), caplog.at_level("WARNING"):
        errors.append(compare(Predictor(STEP), Hidden(2.5), without_speed(run)).free_run_rmse)
        compare(Predictor(STEP), Hidden(2.0), without_speed(shorter))
        jax.jit(lambda x: x + 1)(1.0)
    programs = [r.message for r in caplog.records if "Finished XLA compilation" in r.message]
    assert not [name for name in programs if "from_free" in name or "residual" in name]
    assert len(programs) > 0
    assert errors[0] < 1e-8 < errors[1]


def test_an_unmeasured_state_is_estimated_and_not_compared():
    run, truth = recorded()
    found = compare(Predictor(STEP), Hidden(2.0), without_speed(run))
    assert (found.states, found.units) == (("x",), ("m",))
    np.testing.assert_allclose(found.free_run[:, 0], truth[:, 0], rtol=0, atol=1e-8)
    np.testing.assert_array_equal(found.measured[:, 0], run.channels["x"])


def test_where_the_estimation_of_a_start_begins_does_not_matter():
    run, models = without_speed(recorded()[0]), (Hidden(2.5), Hidden(2.1))
    alone = [compare(Predictor(STEP), model, run) for model in models]
    errors = free_run_errors(Predictor(STEP), [[model] for model in models], [run])
    gaps = [(each.measured - each.free_run)[1:] for each in alone]
    np.testing.assert_allclose(errors[:, 0], [np.sqrt(np.mean(gap**2)) for gap in gaps], rtol=1e-9)


@pytest.mark.parametrize(("last", "begins"), [(2.1, True), (1e6, False)])
def test_free_runs_begin_where_the_last_one_did_unless_it_diverged(monkeypatch, last, begins):
    given = []

    def noted(predictor, model, recording, free, begin):
        given.append(begin)
        return own(predictor, model, recording, free, begin)

    own = free_run._run_of
    monkeypatch.setattr(free_run, "_run_of", noted)
    run = without_speed(recorded()[0])
    free_run_errors(Predictor(STEP), [[Hidden(2.5)], [Hidden(last)]], [run])
    assert given[0] is None
    assert (given[1] is not None) == begins


@pytest.mark.parametrize(("damping", "forgotten"), [(0.05, True), (0.0, False)])
def test_a_start_is_forgotten_where_later_samples_say_nothing_of_it(damping, forgotten):
    """An undamped oscillation has its start in every sample, a damped one in its beginning."""
    time = np.arange(1024)
    wave = np.exp(-damping * time) * np.exp(0.3j * time)
    slopes = np.stack([wave.real, wave.imag], axis=-1)[None]
    assert free_run._forgotten(slopes) == forgotten
    slow = np.stack([wave.real, np.ones(1024)], axis=-1)[None]
    assert not free_run._forgotten(slow)
    assert not free_run._forgotten(slopes[:, :1])


def test_a_start_is_estimated_from_its_beginning_and_no_less_than_asked():
    u = np.sin(0.13 * np.arange(4000))
    still = Experiment("long", STEP, {"x": 0 * u, "v": 0 * u, "u": u})
    x = compare(Predictor(STEP), Seen(2.0), still).free_run[:, 0]
    noisy = x + 1e-3 * np.random.default_rng(0).normal(size=len(u))
    whole = Experiment("long", STEP, {**still.channels, "x": noisy})
    with float64():
        model = with_batch_axis(Hidden(2.0))
        found = free_run._run_of(Predictor(STEP), model, whole, None, None)
        begin = np.asarray(found.start)[0], 2 * found.used
        again = free_run._run_of(Predictor(STEP), model, whole, None, begin)
    assert found.used < 1000
    assert 2 * found.used <= again.used < 4000
    np.testing.assert_allclose(again.start, found.start, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.start, 0.0, atol=3e-3)


def test_one_step_ahead_of_an_unmeasured_state_without_a_guess_is_unknown():
    run, truth = recorded()
    found = compare(Predictor(STEP), Hidden(2.0), without_speed(run))
    assert np.isnan(found.one_step[1:]).all()
    assert np.isfinite(found.free_run).all()
    guessed = compare(Predictor(STEP), Hidden(2.0), run)
    np.testing.assert_allclose(guessed.one_step[1:, 0], truth[1:, 0], rtol=0, atol=1e-12)


def test_the_start_of_a_multistep_solver_is_not_estimated():
    predictor = Predictor(STEP, AdamsBashforth(AB3))
    with pytest.raises(InputError, match=r"starts from 3 samples; choose a one-step solver\.$"):
        compare(predictor, Hidden(2.0), without_speed(recorded()[0]))
