"""The main path on a user's own model: a mass on a spring that is learned.

The model is `Duffing` in conftest.py, ten lines; the data come from a cubic spring.
"""

import dataclasses
import inspect
import re
from itertools import pairwise
from types import FunctionType
from typing import ClassVar

import numpy as np
import pytest

import penode
from penode import (
    Experiment,
    InputError,
    Model,
    Plan,
    Predictor,
    Stage,
    identify,
    ladder_plan,
    parameter,
)
from penode.arrays import Leaf
from penode.horizon.selection import Longest
from penode.models.layout import Layout
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import AB3, EULER, RK4
from penode.training.second_order import LevenbergMarquardt
from penode.validation.free_run import compare

# --- what comes out ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fit(oscillator):
    return oscillator.fit


@pytest.mark.parametrize(
    ("name", "truth", "unit"), [("mass", 0.7, "kg"), ("damping", 0.3, "N s/m")]
)
def test_physical_parameters_lie_in_narrow_intervals(fit, name, truth, unit):
    estimate = fit.parameters[name]
    low, high = estimate.interval_95
    assert low < truth < high
    assert high - low < 0.02 * truth
    assert estimate.unit == unit


def test_the_spring_is_learned_where_it_was_excited(fit):
    """Root mean squared, over the visited states, on forces up to 9 N."""
    x = fit.excited[:, 0]
    truth = 2.0 * x + 1.5 * x**3
    assert np.abs(truth).max() > 5.0
    assert np.sqrt(np.mean((fit.spring(x) - truth) ** 2)) < 0.02


def test_predictions_are_at_the_noise(fit):
    """2 mm and 2 mm/s of noise, and the start's noise in each prediction."""
    training, unseen = fit.comparisons
    assert (training.name, training.role) == ("train.csv", "train")
    assert (unseen.name, unseen.role) == ("unseen.csv", "validation")
    for comparison in (training, unseen):
        assert all(2e-3 < error < 4e-3 for error in comparison.one_step_errors.values())
        assert all(error < 1e-2 for error in comparison.free_run_errors.values())
    assert fit.warnings == ()


def test_a_rung_is_that_of_the_numpy_twin(oscillator, systems):
    """States of two units are each divided by their standard deviation."""
    recording, plan = oscillator.recording, Plan((Stage(8, LevenbergMarquardt(3)),))
    fit = identify(oscillator.fit.model, [recording], plan=plan, purpose=Longest())
    scale = recording.stack(fit.model.states).std(axis=0)
    system = dataclasses.replace(systems["duffing"], scale=scale)
    windows = system.windows(fit.horizon.selected, (recording,))
    raw = Layout(fit.model).raw(fit.model)
    residual, _ = system.sensitivities("rk4", raw, windows)
    (rung,) = fit.horizon.ladder
    assert rung.rmse == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-9)


def test_the_whole_ladder_is_told(oscillator):
    horizon = oscillator.fit.horizon
    assert [rung.horizon for rung in horizon.ladder] == [1, 2, 4, 8, 16]
    assert horizon.answered
    assert horizon.selected in horizon.plateau
    finished = [e for e in oscillator.events if e["event"] == "rung"]
    assert [e["horizon"] for e in finished] == [1, 2, 4, 8, 16]
    for event, rung in zip(finished, horizon.ladder, strict=True):
        assert event["parameters"] == rung.parameters
        assert event["std"] == rung.std
    evaluations = [e for e in oscillator.events if e["event"] == "evaluation"]
    assert {e["stage"] for e in evaluations} == {1, 2, 3, 4, 5}
    assert all(np.isfinite(e["loss"]) for e in evaluations)


# --- what is refused --------------------------------------------------------------------------


def refused(systems, experiments, words, **options):
    with pytest.raises(InputError, match=words) as caught:
        identify(systems["duffing"].model, experiments, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")


def changed(run, **channels):
    return Experiment(run.name, run.time_step, {**run.channels, **channels})


def test_no_recording(systems):
    refused(systems, [], "experiments must have one recording at least")


def test_missing_state(systems):
    run = systems["duffing"].experiments[0]
    rest = {k: v for k, v in run.channels.items() if k != "v"}
    refused(systems, [Experiment("a.csv", 0.05, rest)], r"a\.csv: no channel v; it has x, force")


def test_missing_input(systems):
    run = systems["duffing"].experiments[0]
    rest = {k: v for k, v in run.channels.items() if k != "force"}
    refused(systems, [Experiment("a.csv", 0.05, rest)], r"a\.csv: no channel force; it has x, v")


def test_value_that_is_not_finite(systems):
    run = systems["duffing"].experiments[0]
    force = run.channels["force"].copy()
    force[11] = np.inf
    refused(systems, [changed(run, force=force)], r"run0\.csv: data row 12, channel force is inf")


def test_one_sample(systems):
    short = Experiment("s.csv", 0.05, {k: np.zeros(1) for k in ("x", "v", "force")})
    refused(
        systems, [short], r"s\.csv: horizon 1 with 1 past samples needs at least 2 samples, got 1"
    )


# --- at the edges ----------------------------------------------------------------------------


def test_horizons_too_long_for_the_recordings_are_refused(systems):
    refused(
        systems,
        systems["duffing"].experiments,
        "horizon 5000",
        plan=Plan((Stage(5000, LevenbergMarquardt()),)),
    )


def test_a_horizon_too_long_is_refused_before_shorter_ones_are_trained(systems):
    events = []
    refused(
        systems,
        systems["duffing"].experiments,
        "horizon 5000",
        plan=ladder_plan((1, 5000)),
        observer=events.append,
    )
    assert events == []


def test_validation_of_another_time_step_is_refused(systems, oscillator):
    run = systems["duffing"].experiments[0]
    other = Experiment("slow.csv", 0.1, run.channels)
    with pytest.raises(InputError, match=r"slow\.csv"):
        compare(Predictor(0.05), oscillator.fit.model, other, "validation")


def test_validation_that_is_not_finite_is_refused(systems, oscillator):
    run = systems["duffing"].experiments[0]
    x = run.channels["x"].copy()
    x[3] = np.nan
    with pytest.raises(InputError, match=r"run0\.csv.*row 4.*x is nan"):
        compare(Predictor(0.05), oscillator.fit.model, changed(run, x=x), "validation")


def test_a_state_that_never_moves_is_told(systems):
    run = systems["duffing"].experiments[0]
    refused(systems, [changed(run, v=np.zeros(len(run)))], r"run0\.csv.*v ")


def test_a_plan_without_stages_is_refused():
    with pytest.raises(InputError, match="stage"):
        Plan(())


@pytest.mark.parametrize("solver", [RungeKutta(EULER), AdamsBashforth(AB3)], ids=["euler", "ab3"])
def test_the_plans_solver_is_the_one_used(systems, solver):
    system = systems["duffing"]
    run = system.experiments[0]
    plan = Plan((Stage(1, LevenbergMarquardt()),), solver=solver)
    fit = identify(system.model, [run], plan=plan)
    same = compare(Predictor(run.time_step, solver), fit.model, run, "train")
    other = compare(Predictor(run.time_step, RungeKutta(RK4)), fit.model, run, "train")
    np.testing.assert_array_equal(fit.comparisons[0].one_step, same.one_step)
    assert np.abs(other.one_step - same.one_step).max() > 1e-6
    assert solver.table.name in fit.provenance["solver"]


def test_a_model_without_inputs_can_be_stacked():
    run = Experiment("decay.csv", 0.1, {"x": np.exp(-0.1 * np.arange(9))})
    assert run.stack(()).shape == (9, 0)


class Silent(Model):
    """x' = -k x, with a parameter that is neither physical nor shown by `learned`."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    k: Leaf = parameter()

    def derivative(self, x, u):
        return -self.k * x + 0 * u.values


def test_a_model_that_reports_nothing_is_trained_all_the_same():
    x = np.exp(-0.3 * 0.1 * np.arange(60))
    run = Experiment("decay.csv", 0.1, {"x": x, "u": 0 * x})
    fit = identify(Silent(1.0), [run], plan=ladder_plan((1,)))
    assert fit.model.k == pytest.approx(0.3, rel=1e-3)


# --- the public names -------------------------------------------------------------------------

PUBLIC = [getattr(penode, name) for name in penode.__all__]


def sections(thing):
    lines = (inspect.getdoc(thing) or "").splitlines()
    return {a for a, b in pairwise(lines) if re.fullmatch("-{3,}", b)}


def documented(thing, heading):
    """Whether the section is there, or another docstring that has it is pointed to."""
    return heading in sections(thing) or "; see `" in inspect.getdoc(thing)


def test_all_names_of_the_design_are_public():
    assert {"load", "identify", "Plan", "Fit", "Experiment", "pmsm"} <= set(penode.__all__)
    assert penode.__all__ == sorted(penode.__all__)


@pytest.mark.parametrize("thing", PUBLIC, ids=penode.__all__)
def test_public_names_say_what_they_are(thing):
    first = (inspect.getdoc(thing) or "").split("\n\n")[0]
    assert len(first) > 20
    assert first.endswith(".")


@pytest.mark.parametrize("thing", [p for p in PUBLIC if inspect.isfunction(p)])
def test_public_functions_have_numpydoc_sections(thing):
    if len(inspect.signature(thing).parameters) > 1:
        assert documented(thing, "Parameters")
    if inspect.signature(thing).return_annotation is not None:
        first = inspect.getdoc(thing)
        assert "Returns" in sections(thing) or first.startswith(("Return", "Declare"))


@pytest.mark.parametrize("thing", [p for p in PUBLIC if dataclasses.is_dataclass(p)])
def test_public_records_document_their_fields(thing):
    text = inspect.getdoc(thing)
    own = [f.name for f in dataclasses.fields(thing)]
    if own:
        assert sections(thing) & {"Attributes", "Class attributes"}
    for name in own:
        assert re.search(rf"^(\w+, )*{name}(, \w+)* :", text, flags=re.MULTILINE), name
    for name, member in vars(thing).items():
        if not name.startswith("_") and isinstance(member, (FunctionType, classmethod, property)):
            assert inspect.getdoc(member), name
