"""Where a rung begins: at what the one before predicts, and found, unless that was lost."""

from dataclasses import replace

import numpy as np
import pytest
from validate.physics.kind import draw
from validate.physics.kinds import KINDS

from penode.horizon.default_plan import default_plan
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.predictors.base import Predictor
from penode.validation import free_run
from penode.validation.free_run import compare


@pytest.fixture(scope="module")
def prey():
    """Prey that is measured, and predators that are not."""
    return draw(KINDS["predator_prey"], 0)


def errors(prey, horizons=(7, 60, 400)):
    """Return the relative error of each parameter at the last rung."""
    run, start = prey.train.experiment, prey.start
    plan = default_plan(start, [run])
    stages = [replace(plan.stages[0], horizon=h) for h in horizons]
    plan = replace(plan, stages=tuple(stages))
    problem = LadderProblem.of(start, [run], plan, ignore_events)
    rungs = problem.climb(plan, problem.objective.layout.raw(start)).fits
    names = problem.objective.layout.physical
    true = np.array([prey.truth[name] for name in names])
    return np.abs(rungs[-1].values[: len(names)] / true - 1)


@pytest.mark.slow
def test_long_windows_begin_at_what_shorter_ones_predict(prey, monkeypatch):
    """From zero their starts end in other minima, and the parameters with them."""
    assert errors(prey).max() < 0.02
    monkeypatch.setattr(LadderProblem, "hidden_states", lambda self, *given: [{}])
    assert errors(prey).max() > 0.05


def test_the_start_of_a_free_run_is_estimated_by_its_beginning_first(prey, monkeypatch):
    run = prey.train.experiment
    true = replace(prey.start, **prey.truth)
    predictor = Predictor(run.time_step)
    found = compare(predictor, true, run).free_run_rmse
    monkeypatch.setattr(free_run, "_BEGINNING", 10**9)
    assert compare(predictor, true, run).free_run_rmse > 2 * found


@pytest.mark.slow
def test_a_parameter_that_ran_to_zero_begins_anew_at_the_next_rung(monkeypatch):
    """The shortest windows of a two-mass drive want a negative damping, which it cannot have."""
    drive = draw(KINDS["two_mass"], 6)
    assert errors(drive, (11, 40)).max() < 0.02
    monkeypatch.setattr(LadderProblem, "_lost", lambda self, *given: False)
    assert errors(drive, (11, 40)).max() > 0.9
