"""Scores by sample: their sum is that by window, their deviations are those of repetition."""

from dataclasses import replace

import numpy as np
import pytest
from tests.laws.test_intervals_cover import disturbed_runs

from penode import Predictor
from penode.data.windows import Jittered, cut
from penode.horizon.ladder import LadderProblem
from penode.training.loss import Loss, Prefilter
from penode.training.plan import Plan, Stage
from penode.training.residuals import Objective
from penode.training.second_order import LevenbergMarquardt

pytestmark = pytest.mark.usefixtures("quickly_compiled")

LOSSES = {
    "starts as measured": Loss(),
    "a start that is free": Loss(free_starts={"i_d": np.inf}),
    "both starts, one more sample each": Loss(free_starts={"i_d": None, "i_q": 0.3}),
    "a prefilter": Loss(prefilter=Prefilter((1.0, -0.4), (1.0, 0.2)), free_starts={"i_q": None}),
}


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_the_sum_over_samples_is_that_over_windows(systems, loss):
    system = systems["linear machine"]
    runs = disturbed_runs(system, np.random.default_rng(1))
    objective = Objective(Predictor(system.time_step), system.model, np.array([1.0, 2.0]), loss, 2)
    placement = Jittered(2, fewest=7)
    windows = cut(runs, system.model.states, system.model.inputs, 60, placement=placement)
    raw = objective.layout.raw(system.model) * 1.02
    by_window = objective.gauss_newton(raw, windows).scores
    by_sample = objective.sample_scores(raw, windows)
    starts = objective.gauss_newton(raw, windows).starts
    np.testing.assert_array_equal(objective.sample_scores(raw, windows, starts), by_sample)
    if len(starts):
        assert np.any(objective.sample_scores(raw, windows, starts + 1.0) != by_sample)
    assert by_sample.shape == (len(raw), len(windows.states))
    size = np.abs(by_window).sum(axis=1)
    assert np.abs(by_sample.sum(axis=1) - by_window.sum(axis=1)).max() < 1e-6 * size.max()
    np.testing.assert_allclose(
        by_sample.sum(axis=1) / size, by_window.sum(axis=1) / size, rtol=0, atol=1e-6
    )


def test_a_score_is_that_of_the_sample_it_predicts(systems):
    """Moving one measured sample changes only its own score where starts are as measured."""
    system = systems["linear machine"]
    (run, *_) = disturbed_runs(system, np.random.default_rng(1))
    objective = Objective(Predictor(system.time_step), system.model, np.ones(2))
    raw, scores = objective.layout.raw(system.model) * 1.02, []
    for change in (0.0, 1.0):
        channels = {name: np.array(values) for name, values in run.channels.items()}
        channels["i_d"][33] += change
        moved = replace(run, channels=channels)
        windows = cut([moved], system.model.states, system.model.inputs, 25)
        scores.append(objective.sample_scores(raw, windows))
    assert 33 not in windows.starts
    assert np.flatnonzero(np.any(scores[0] != scores[1], axis=0)).tolist() == [33]


@pytest.mark.slow
def test_horizons_too_long_for_windows_have_deviations_of_unit_size(systems):
    """Of 190 samples four windows of 75 show none; at the samples the residual is known."""
    system, errors, deviations = systems["linear machine"], [], []
    plan = Plan((Stage(75, LevenbergMarquardt(tolerance=0.01)),))
    plan = replace(plan, placement=Jittered(0, fewest=10))
    loss, problem = Loss(free_starts=dict.fromkeys(("i_d", "i_q"))), None
    plan = replace(plan, loss=loss)
    for seed in range(100):
        runs = system.recorded_again(noise=0.02, seed=seed)
        problem = problem or LadderProblem.of(system.model, runs, plan, lambda event: None)
        (rung,) = replace(problem, experiments=runs).climb(plan, system.raw).fits
        assert rung.influence.shape[1] == len(rung.windows.states)
        errors.append(rung.values - problem.reported.values(system.raw))
        deviations.append(rung.deviation)
    size = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(deviations), axis=0))
    # 100 repetitions know it to 7 %; Newey-West on 380 samples understates by 5 to 15 %.
    assert (size > 0.8).all(), size
    assert (size < 1.35).all(), size
