"""Horizons chosen by prediction, on a machine whose resistance alone is wrong at some rungs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from penode.horizon.held_out import FREE_RUN, HeldOut
from penode.horizon.ladder import HorizonFit
from penode.predictors.base import Predictor
from penode.validation.free_run import compare


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
    choice = HeldOut(run, (1,)).select(ladder(0.0, 1e-12, 0.0))
    assert choice.index == 0
    assert choice.agreeing == (0, 1, 2)


def test_one_step_and_free_run_may_disagree(systems, ladder):
    """One step hardly sees a resistance in noise; a free run does."""
    run = systems["linear machine"].recorded_again(noise=0.05)
    rungs = ladder(0.02, 0.0)

    def gap(look_ahead):
        wrong, right = (HeldOut(run, (look_ahead,)).squared_errors(one) for one in rungs)
        return np.mean([np.log(a.mean() / b.mean()) for a, b in zip(wrong, right, strict=True)])

    assert abs(gap(FREE_RUN)) > 3 * abs(gap(1))


def test_squared_errors_are_those_written_out(systems, ladder):
    run, rung = systems["linear machine"].recorded_again(noise=0.05)[0], ladder(0.1)[0]
    (found,) = HeldOut([run], (1, FREE_RUN)).squared_errors(rung)
    seen = compare(rung.predictor, rung.model, run)
    for k, ahead in enumerate((seen.one_step, seen.free_run)):
        assert found[k] == pytest.approx((seen.measured[1:] - ahead[1:]) ** 2)


def test_a_diverging_rung_is_never_taken(systems, ladder):
    run = systems["linear machine"].recorded_again(noise=0.0)
    lost = ladder(-1e9, 0.0)
    assert HeldOut(run, (FREE_RUN,)).select(lost).index == 1
    none = HeldOut(run, (FREE_RUN,)).select(lost[:1])
    assert none.verdict == "no plateau"


class Scored(HeldOut):
    """Selection among rungs whose errors are given."""

    def squared_errors(self, rung):
        return [np.full((1, 2, 1), np.exp(2 * score)) for score in rung.scores]


def selected(*scores):
    """Select among rungs H = 1, 2, 4, ... of these logarithmic errors, one a recording."""
    rungs = [SimpleNamespace(horizon=2**k, scores=s) for k, s in enumerate(scores)]
    return Scored((), (1, 10, FREE_RUN)).select(rungs)


@pytest.mark.parametrize(("excess", "agreeing"), [(0.057, (0, 1)), (0.058, (1,))])
def test_rungs_agree_within_one_standard_error(excess, agreeing):
    """Of four recordings that scatter by 0.1: the root of 4 / 3 times that, over the root of 4."""
    scatter = np.array([0.1, -0.1, 0.1, -0.1])
    choice = selected(excess + scatter, np.zeros(4))
    assert (choice.index, choice.agreeing) == (1, agreeing)


def test_the_least_error_is_taken_though_another_is_within_chance_of_it():
    choice = selected(np.full(4, 5.0), 0.005 + 0.01 * np.arange(-1.5, 2), np.full(4, 7.0), [0] * 4)
    assert choice.index == 3
    assert choice.agreeing == (1, 3)
    assert choice.reason == (
        "H = 8 has the least error in one step and 10 steps and free run; H = 2 errs more by no "
        "more than chance."
    )


def test_a_rung_that_diverges_in_one_recording_is_not_taken():
    assert selected([-9.0, np.inf, -9.0, -9.0], np.zeros(4)).index == 1
    assert selected([np.inf], [np.inf]).verdict == "no plateau"


def test_a_state_without_error_does_not_decide():
    """A current that is zero throughout, at standstill, is predicted exactly at every horizon."""

    class TwoStates(HeldOut):
        def squared_errors(self, rung):
            return [np.stack([np.zeros(80), np.full(80, 1.0 / rung.horizon)], axis=1)[None]]

    choice = TwoStates((), (FREE_RUN,)).select([SimpleNamespace(horizon=h) for h in (1, 2)])
    assert (choice.index, choice.agreeing) == (1, (1,))


def test_a_single_recording_is_judged_as_a_whole_and_agreement_by_stretches():
    """A rung better in seven of eight stretches is not best where the eighth is far off."""
    worse = np.ones((1, 80, 1))
    worse[:, :10] = 100.0

    class Single(HeldOut):
        def squared_errors(self, rung):
            return [{1: worse, 2: np.full((1, 80, 1), 2.0)}[rung.horizon]]

    choice = Single((), (FREE_RUN,)).select([SimpleNamespace(horizon=h) for h in (1, 2)])
    assert choice.index == 1
    assert choice.agreeing == (0, 1)
