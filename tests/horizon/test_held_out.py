"""Horizons chosen by prediction, on a machine whose resistance alone is wrong at some rungs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from penode.horizon.held_out import FREE_RUN, HeldOut
from penode.horizon.ladder import HorizonFit
from penode.predictors.base import Predictor


@pytest.fixture
def ladder(systems):
    """Rungs of a linear machine, R off by a share at each."""
    system = systems["linear machine"]

    def make(*errors):
        models = [replace(system.model, R=np.array(system.model.R * (1 + e))) for e in errors]
        unseen = dict.fromkeys(
            ("solution", "values", "deviation", "working", "influence", "series")
        )
        return [
            HorizonFit(
                horizon=2**k,
                windows=None,
                predictor=Predictor(system.time_step),
                model=model,
                **unseen,
            )
            for k, model in enumerate(models)
        ]

    return make


@pytest.mark.parametrize("look_aheads", [(1,), (1, 10), (FREE_RUN,)])
def test_the_model_that_predicts_is_taken(systems, ladder, look_aheads):
    run = systems["linear machine"].recorded_again(noise=0.0)
    choice = HeldOut(run, look_aheads).select(ladder(0.3, -0.1, 0.0, 0.2))
    assert (choice.index, choice.verdict) == (2, "predicts best")
    assert choice.agreeing == (2,)
    assert "H = 4" in choice.reason


def test_of_equal_rungs_the_shortest_is_taken(systems, ladder):
    run = systems["linear machine"].recorded_again(noise=0.05)
    choice = HeldOut(run, (1,)).select(ladder(0.0, 1e-9, 0.0))
    assert choice.index == 0
    assert choice.agreeing == (0, 1, 2)


def test_one_step_and_free_run_may_disagree(systems, ladder):
    """One step hardly sees a resistance in noise; a free run does."""
    run = systems["linear machine"].recorded_again(noise=0.05)
    rungs = ladder(0.02, 0.0)
    assert HeldOut(run, (1,)).select(rungs).agreeing == (0, 1)
    gap = HeldOut(run, (FREE_RUN,)).scores(rungs[0]) - HeldOut(run, (FREE_RUN,)).scores(rungs[1])
    step = HeldOut(run, (1,)).scores(rungs[0]) - HeldOut(run, (1,)).scores(rungs[1])
    assert abs(gap.mean()) > 3 * abs(step.mean())


def test_scores_are_logarithms_of_errors_written_out(systems, ladder):
    system = systems["linear machine"]
    run = system.recorded_again(noise=0.05)
    rung = ladder(0.1)[0]
    found = HeldOut([*run, *run], (1,)).scores(rung)
    assert len(found) == 2 * len(run) if len(run) > 1 else 2
    measured = run[0].stack(system.model.states)
    from penode.validation.free_run import compare

    told = compare(rung.predictor, rung.model, run[0])
    gap = (told.measured[1:] - told.one_step[1:]) / measured[1:].std(axis=0)
    assert found[0] == pytest.approx(0.5 * np.log(np.mean(np.sum(gap**2, axis=1))))


def test_a_diverging_rung_is_never_taken(systems, ladder):
    run = systems["linear machine"].recorded_again(noise=0.0)
    lost = ladder(-1e9, 0.0)
    assert HeldOut(run, (FREE_RUN,)).select(lost).index == 1
    none = HeldOut(run, (FREE_RUN,)).select(lost[:1])
    assert none.verdict == "no plateau"


class Scored(HeldOut):
    """Selection among rungs whose scores are given."""

    def scores(self, rung):
        return np.asarray(rung.scores)


def selected(*scores):
    """Select among rungs H = 1, 2, 4, ... of these logarithmic errors, one a regime."""
    rungs = [SimpleNamespace(horizon=2**k, scores=s) for k, s in enumerate(scores)]
    return Scored((), (1, 10, FREE_RUN)).select(rungs)


@pytest.mark.parametrize(("excess", "index"), [(0.057, 0), (0.058, 1)])
def test_a_shorter_horizon_may_be_worse_by_one_standard_error(excess, index):
    """Of four regimes that scatter by 0.1: the root of 4 / 3 times that, over the root of 4."""
    scatter = np.array([0.1, -0.1, 0.1, -0.1])
    assert selected(excess + scatter, np.zeros(4)).index == index


@pytest.mark.parametrize(("excess", "index"), [(0.0099, 0), (0.0101, 1)])
def test_one_percent_does_not_matter_however_sure_it_is(excess, index):
    assert selected(np.full(4, excess), np.zeros(4)).index == index


def test_the_shortest_is_taken_though_a_longer_one_between_is_worse():
    choice = selected(np.full(4, 5.0), np.full(4, 0.005), np.full(4, 7.0), np.zeros(4))
    assert choice.index == 1
    assert choice.agreeing == (1, 3)
    assert choice.reason == (
        "H = 2 is the shortest whose error in one step and 10 steps and free run is not above the "
        "lowest (H = 8) by more than chance or 1 %."
    )


def test_a_rung_that_diverges_in_one_regime_is_not_taken():
    assert selected([-9.0, np.inf, -9.0, -9.0], np.zeros(4)).index == 1


def test_a_single_recording_is_judged_in_eight_stretches(systems, ladder):
    """A disturbance of one stretch leaves the scores of the others."""
    (run, _), (rung,) = systems["linear machine"].recorded_again(noise=0.05), ladder(0.0)
    disturbed = run.channels["i_q"].copy()
    disturbed[120] += 5.0
    other = replace(run, channels={**run.channels, "i_q": disturbed})
    clean, hit = (HeldOut([one], (1,)).scores(rung) for one in (run, other))
    assert clean.shape == (8,)
    # One deviation divides all stretches, and the disturbance moves it a little.
    assert np.flatnonzero(np.abs(hit - clean) > 0.1).tolist() == [4]
