"""Answers that contradict an anchor, or depend on the path, are told."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from penode.horizon import search
from penode.horizon.assemble import Assembly
from penode.horizon.cross_checks import (
    Anchor,
    CrossCheck,
    check_against_anchor,
    check_path_dependence,
    cross_check,
)
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Climb, HorizonFit, LadderProblem, ignore_events, ladder_plan
from penode.horizon.search import Search
from penode.horizon.selection import Choice, Longest
from penode.identify import Stopped, identify
from penode.training.loss import Loss
from penode.training.plan import CONVERGED, Solution, ignore_progress
from penode.training.second_order import LevenbergMarquardt


def rung(horizon, value, deviation):
    nothing = dict.fromkeys(("solution", "influence", "windows", "series", "predictor", "model"))
    values, working = np.array([value]), np.array([deviation])
    return HorizonFit(horizon=horizon, values=values, deviation=working, working=working, **nothing)


LADDER = [rung(1, 5.0, 0.1), rung(4, 9.7, 0.2), rung(16, 10.1, 0.3)]


@pytest.mark.parametrize(
    ("anchor", "index", "verdict"),
    [(10.0, 1, "plateau"), (5.05, 0, "H = 1 suffices"), (20.0, 2, "no plateau")],
)
def test_the_shortest_horizon_that_agrees_with_the_anchor(anchor, index, verdict):
    choice = Anchor(np.array([anchor]), np.array([0.1])).select(LADDER)
    assert (choice.index, choice.verdict) == (index, verdict)


def test_an_unsure_anchor_lets_one_step_stand():
    choice = Anchor(np.array([10.0]), np.array([5.0])).select(LADDER)
    assert choice.index == 0
    assert choice.agreeing == (0, 1, 2)


def test_a_contradiction_is_told_with_both_numbers():
    small, (large,) = check_against_anchor(LADDER[0], ("R",), {"R": (10.0, 0.2)})
    assert large.reason.startswith("R = 5 contradicts 10 ± 0.2")
    assert small == ()
    assert check_against_anchor(LADDER[2], ("R",), {"R": (10.0, 0.2)}) == ((), ())
    assert check_against_anchor(LADDER[0], ("R",), {}) == ((), ())


def test_a_contradiction_of_a_few_percent_is_a_warning():
    sure = rung(1, 9.7, 0.02)
    (sentence,), objections = check_against_anchor(sure, ("R",), {"R": (10.0, 0.02)})
    assert sentence.startswith("R = 9.7 contradicts 10 ± 0.02")
    assert objections == ()


def test_another_minimum_reached_directly_is_told(systems):
    """A ladder that was left at a poor place, and a start from which the minimum is reached."""
    system = systems["linear machine"]
    plan = ladder_plan((4,))
    problem = LadderProblem.of(system.model, system.recorded_again(0.05), plan, lambda event: None)
    start = problem.objective.layout.raw(system.model)
    at_the_minimum = problem.climb(plan, start).fits[0]
    assert check_path_dependence(problem, plan, at_the_minimum, start) == ((), None)
    wrong = replace(system.model, R=np.array(3 * system.model.R))
    stuck = replace(plan.stages[0], optimiser=LevenbergMarquardt(evaluations=1))
    poor = problem.climb(replace(plan, stages=(stuck,)), problem.objective.layout.raw(wrong)).fits[
        0
    ]
    told, better = check_path_dependence(problem, plan, poor, start)
    assert any(sentence.startswith("R depends on the path") for sentence in told)
    np.testing.assert_allclose(better, at_the_minimum.solution.raw, rtol=1e-3)
    assert check_path_dependence(problem, replace(plan, detour=None), poor, start) == ((), None)


def test_a_path_that_strayed_is_checked_at_the_longest_horizon_whatever_was_chosen(systems):
    """A ladder whose last rung was left at three times the resistance."""
    system = systems["linear machine"]
    free = Loss(free_starts={"i_d": 1.0, "i_q": 1.0})
    plan = replace(ladder_plan((4, 16)), loss=free)
    problem = LadderProblem.of(system.model, system.recorded_again(0.05), plan, lambda event: None)
    raw = problem.objective.layout.raw(system.model)
    right = problem.climb(plan, raw)
    start = SimpleNamespace(anchor={}, model=system.model)
    chosen = Choice(0, "fixed", "", (0,))
    assert cross_check(problem, plan, right, chosen, start).better is None
    wrong = problem.objective.layout.raw(replace(system.model, R=np.array(3 * system.model.R)))
    stuck = (plan.stages[0], replace(plan.stages[1], optimiser=Stays(wrong)))
    poor = problem.climb(replace(plan, stages=stuck), raw)
    index, better = cross_check(problem, plan, poor, chosen, start).better
    assert index == 1
    np.testing.assert_allclose(better, right.fits[1].solution.raw, rtol=1e-3)


@pytest.mark.parametrize(("loss", "kept"), [(0.5, True), (2.0, False)])
def test_every_horizon_begins_at_a_better_start_and_the_better_climb_is_kept(
    systems, monkeypatch, loss, kept
):
    system, raw, begun = systems["linear machine"], np.arange(4.0), []
    plan = ladder_plan((4, 16))
    told = iter([CrossCheck(better=(1, raw)), CrossCheck()])

    def climbed(name, loss):
        return SimpleNamespace(
            name=name, plan=plan, loss_at=lambda index: loss, cross_checked=lambda start: next(told)
        )

    def again(self, plan, places):
        begun.append(places)
        return climbed("second", loss)

    monkeypatch.setattr(search, "climbed_as_recorded", lambda *given: climbed("first", 1.0))
    monkeypatch.setattr(Search, "_climbed", again)
    monkeypatch.setattr(Search, "_compared", lambda self, found, check: found.name)
    monkeypatch.setattr(search, "examined", lambda found: found)
    asked = Search(Start(system.model), [], Longest(), ignore_events)
    assert asked.as_recorded(plan) == ("second" if kept else "first")
    assert begun == [{4: raw, 16: raw}]


@dataclass(frozen=True, eq=False)
class Stays:
    """An optimiser that ends at given raw parameters."""

    raw: np.ndarray

    def minimise(self, problem, raw, progress=ignore_progress):
        return Solution(self.raw, problem.gauss_newton(self.raw), 1, CONVERGED)


@dataclass(frozen=True)
class Interrupted:
    """An optimiser during which a person presses Ctrl-C."""

    def minimise(self, problem, raw, progress=ignore_progress):
        raise KeyboardInterrupt


def test_ctrl_c_after_the_last_horizon_leaves_the_whole_result(systems, monkeypatch):
    system, events = systems["linear machine"], []
    runs, plan = system.recorded_again(0.05), ladder_plan((1, 4))
    settled = {"plan": replace(plan, detour=None), "purpose": Longest()}
    whole = identify(system.model, runs, **settled)
    made, pressed = Assembly.fit, []

    def interrupted(self, *given):
        if not pressed:
            pressed.append(True)
            raise KeyboardInterrupt
        return made(self, *given)

    monkeypatch.setattr(Assembly, "fit", interrupted)
    with pytest.raises(Stopped) as stop:
        identify(system.model, runs, **settled, observer=events.append)
    assert events[-1] == {"event": "stop", "horizon": 4}
    assert stop.value.fit.parameters == whole.parameters
    assert stop.value.fit.horizon == whole.horizon


def test_an_interrupted_cross_check_keeps_the_fit_and_says_so(systems):
    system, events = systems["linear machine"], []
    runs, plan = system.recorded_again(0.05), ladder_plan((1, 4))
    whole = identify(system.model, runs, plan=replace(plan, detour=None), purpose=Longest())
    with pytest.raises(Stopped) as stop:
        identify(
            system.model,
            runs,
            plan=replace(plan, detour=Interrupted()),
            purpose=Longest(),
            observer=events.append,
        )
    fit = stop.value.fit
    assert events[-1] == {"event": "stop", "horizon": 4}
    assert fit.parameters == whole.parameters
    assert fit.horizon.ladder == whole.horizon.ladder
    assert fit.horizon.verdict == "stopped"
    assert fit.horizon.reason == (
        "The cross-check of the horizon was interrupted. Before it: The horizon was set to 4 by "
        "the user."
    )
    assert [w for w in fit.warnings if w not in whole.warnings] == [
        "Stopped during the cross-check; whether the estimate depends on the path of training is "
        "open."
    ]


# --- how far apart ----------------------------------------------------------------------------


@pytest.mark.parametrize(("gap", "agrees"), [(1.99, True), (2.01, False)])
def test_an_anchor_agrees_within_two_deviations_of_both(gap, agrees):
    """Deviations of 3 and 4 are 5 together."""
    choice = Anchor(np.array([20.0]), np.array([4.0])).select([rung(7, 20.0 - 5 * gap, 3.0)])
    assert (choice.verdict == "H = 1 suffices") == agrees
    assert ("H = 7 is 2.0 deviations away" in choice.reason) == (not agrees)


def test_every_parameter_has_to_agree_with_its_anchor():
    two = replace(LADDER[0], values=np.array([5.0, 1.0]), working=np.array([0.1, 0.1]))
    told = Anchor(np.array([5.0, 2.0]), np.array([0.1, 0.1])).select([two])
    assert told.verdict == "no plateau"


@pytest.mark.parametrize(
    ("value", "small", "large"),
    [
        (10 + 5 * 3.99, 0, 0),
        (10 + 5 * 4.01, 0, 1),
        (10 - 5 * 4.01, 0, 1),
    ],
)
def test_a_contradiction_is_four_deviations_of_both(value, small, large):
    told = check_against_anchor(rung(1, value, 3.0), ("R",), {"R": (10.0, 4.0)})
    assert tuple(map(len, told)) == (small, large)


@pytest.mark.parametrize(("value", "small", "large"), [(-9.51, 1, 0), (-9.49, 0, 1)])
def test_a_contradiction_is_large_from_five_percent_of_the_anchor(value, small, large):
    told = check_against_anchor(rung(1, value, 0.01), ("R",), {"R": (-10.0, 0.01)})
    assert tuple(map(len, told)) == (small, large)


class Unused:
    """A problem of which only the names and the start are asked for."""

    objective = SimpleNamespace(
        layout=SimpleNamespace(physical=("R",), raw=lambda model: np.zeros(1))
    )


def test_what_was_stopped_is_not_checked_and_one_step_not_for_its_path():
    """A start anew at the shortest horizon is the ladder itself."""
    start = SimpleNamespace(anchor={"R": (10.0, 0.2)}, model=None)
    plan = ladder_plan((1, 4, 16), seed=0)
    choice = Choice(0, "fixed", "", (0,))
    stopped = cross_check(Unused(), plan, Climb(tuple(LADDER), interrupted=True), choice, start)
    assert (stopped.contradictions, stopped.objections) == ((), ())
    checked = cross_check(Unused(), plan, Climb(tuple(LADDER)), choice, start)
    assert (len(checked.objections), checked.interrupted) == (1, False)
