"""The ladder: which rungs, in which order, from where, and who is told."""

import gc
import weakref
from dataclasses import dataclass, field, replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import (
    Contiguous,
    Experiment,
    InputError,
    Jittered,
    Model,
    Plan,
    Stage,
    ladder_plan,
    physical,
)
from penode.horizon.ladder import HORIZONS, LadderProblem, fitting_plan, strayed
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.coarse_to_fine import CoarseToFine
from penode.training.covariance import Reported, ScoreSeries
from penode.training.loss import Loss
from penode.training.plan import CONVERGED, DIVERGED, Solution
from penode.training.residuals import Objective
from penode.training.second_order import LevenbergMarquardt

# --- plans ------------------------------------------------------------------------------------


def test_default_ladder_grows_by_about_one_and_a_half_to_450():
    plan = ladder_plan()
    horizons = [stage.horizon for stage in plan.stages]
    assert tuple(horizons) == HORIZONS
    assert (horizons[0], horizons[-1]) == (1, 450)
    growth = np.array(horizons[3:]) / horizons[2:-1]
    assert ((growth > 1.4) & (growth < 1.7)).all()
    assert plan.placement == Jittered(0)
    assert all(stage.groups is None for stage in plan.stages)
    thinned = [isinstance(stage.optimiser, CoarseToFine) for stage in plan.stages]
    assert thinned == [True] + [False] * (len(HORIZONS) - 1)


def test_ladder_takes_horizons_optimiser_and_seed():
    optimiser = LevenbergMarquardt(evaluations=7)
    plan = ladder_plan((3, 9), optimiser, seed=5)
    assert plan.stages == (Stage(3, optimiser), Stage(9, optimiser))
    assert plan.placement == Jittered(5)
    assert plan.detour is not None


@pytest.mark.parametrize("horizons", [(), (0, 1), (-1,), (1, 3, 2), (1, 2, 2)])
def test_horizons_ascend_from_one(horizons):
    with pytest.raises(InputError, match=r"^horizons must be ascending whole numbers above 0, got"):
        ladder_plan(horizons)


def test_stages_with_few_windows_are_dropped(systems):
    """The shorter recording has 150 samples: 20 windows of 7."""
    plan = fitting_plan(
        Plan(ladder_plan((1, 5, 7, 8, 40)).stages, Contiguous()), systems["duffing"].experiments
    )
    assert [stage.horizon for stage in plan.stages] == [1, 5, 7]
    assert plan.placement == Contiguous()


# --- climbing ---------------------------------------------------------------------------------


@dataclass(eq=False)
class Scripted:
    """An optimiser that adds to the raw vector what it is told, or diverges."""

    steps: list
    outcome: str = CONVERGED
    calls: list = field(default_factory=list)

    def minimise(self, problem, raw, progress):
        step = self.steps[len(self.calls)]
        self.calls.append((problem, raw))
        progress(raw, 1.5)
        if step is None:
            return Solution(raw, problem.gauss_newton(raw), 1, DIVERGED)
        raw = raw + step * problem.moving
        return Solution(raw, problem.gauss_newton(raw), 4, self.outcome)


@pytest.fixture
def problem(systems, objective_of):
    system = systems["linear machine"]
    objective = objective_of(system)
    reported = Reported(objective.layout, np.zeros((1, 2)))
    return LadderProblem(objective, reported, system.model, system.experiments, observer=[].append)


def told(problem):
    return problem.observer.__self__


def test_each_rung_starts_where_the_one_before_ended(systems, problem):
    system, script = systems["linear machine"], Scripted([0.01, 0.02, 0.04])
    stages = tuple(Stage(h, script) for h in (1, 3, 7))
    rungs = problem.climb(Plan(stages, Contiguous()), system.raw).fits
    starts = np.stack([raw for _, raw in script.calls])
    np.testing.assert_allclose(starts - system.raw, np.array([[0.0], [0.01], [0.03]]) + np.zeros(4))
    assert [rung.horizon for rung in rungs] == [1, 3, 7]
    np.testing.assert_allclose(rungs[-1].solution.raw, system.raw + 0.07)
    # Contiguous windows of 3 in recordings of 230 and 150 samples.
    np.testing.assert_array_equal(rungs[1].windows.starts[:3], [0, 3, 6])
    assert rungs[1].windows.horizon == 3


@pytest.mark.parametrize(
    ("outcome", "step", "goes_on"),
    [(CONVERGED, 0.5, 0.5), ("Lost.", 0.5, 0.0)],
)
def test_after_a_rung_that_did_not_converge_the_better_start_is_taken(
    systems, problem, outcome, step, goes_on
):
    """The recording is the model's own: away from its parameters every loss is larger."""
    system, script = systems["linear machine"], Scripted([step, 0.0], outcome)
    problem.climb(Plan(tuple(Stage(h, script) for h in (1, 3))), system.raw)
    np.testing.assert_allclose(script.calls[1][1], system.raw + goes_on, rtol=1e-12)


class Saturated(Model):
    """v' = rate (u - v), read as tanh(v), which far away shows nothing of v."""

    states: ClassVar = ("v",)
    inputs: ClassVar = ("u",)
    outputs: ClassVar = {"y": "V"}
    state_units: ClassVar = ("V",)

    rate: object = physical("1/s")

    def derivative(self, x, u):
        return self.rate * (u[0] - x)

    def output(self, x, u):
        return jnp.tanh(x)


@pytest.mark.parametrize(("guess", "kept"), [(20.0, False), (0.3, True)])
def test_hidden_states_that_lead_astray_are_forgotten(guess, kept):
    """Where windows search from, after a rung that did not converge, is what leaves less loss."""
    u, v = np.sin(0.2 * np.arange(60)), np.zeros(60)
    for k in range(59):
        v[k + 1] = u[k] + (v[k] - u[k]) * np.exp(-0.1)
    run = Experiment("run", 0.1, {"u": u, "y": np.tanh(v)})
    script = Scripted([0.3, 0.0], "Lost.")
    plan = Plan(tuple(Stage(h, script) for h in (3, 6)), Contiguous())
    ladder = LadderProblem.of(Saturated(1.0), [run], plan, lambda event: None)
    found = [{"v": np.full(60, guess)}]
    object.__setattr__(ladder, "hidden_states", lambda *given: found)
    list(ladder.solutions(plan, ladder.objective.layout.raw(Saturated(1.0))))
    assert (ladder.guesses.get(6) is found) == kept
    assert script.calls[1][0].windows.states[0, 0] == (guess if kept else 0.0)
    np.testing.assert_array_equal(script.calls[1][1], script.calls[0][1])


def test_a_rung_carries_its_values_deviations_and_influences(systems, problem):
    system = systems["linear machine"]
    enough = replace(problem, experiments=system.experiments * 5)
    (rung,) = enough.climb(Plan((Stage(7, Scripted([0.0])),)), system.raw).fits
    np.testing.assert_allclose(rung.values, [2e-3, 3e-3, 0.2, 0.05], rtol=1e-12)
    residual, slope = system.sensitivities("rk4", system.raw, rung.windows)
    rows = np.moveaxis(slope, 2, -1).reshape(-1, 4)
    scores = np.einsum("kspw,ksw->pw", slope, residual)
    physical = np.diag([2e-3, 3e-3, 1.0, 1.0])
    expected = physical @ np.linalg.solve(rows.T @ rows, scores)
    size = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(rung.influence / size, expected / size, rtol=0, atol=1e-9)
    assert rung.deviation.shape == (4,)
    assert rung.series.ample


def test_in_a_short_recording_influences_are_those_of_samples(systems, problem):
    """380 samples are 7 bandwidths of windows: too few for intervals by a normal distribution."""
    system = systems["linear machine"]
    plan = Plan((Stage(27, Scripted([0.0])),), Contiguous())
    (short,) = problem.climb(plan, system.raw).fits
    assert not ScoreSeries.of_windows(short.windows).ample
    assert short.influence.shape == (4, 380)
    np.testing.assert_array_equal(short.series.places, np.arange(380))


@pytest.mark.parametrize(("times", "lost"), [(2.9, False), (3.1, True)])
def test_a_path_may_have_strayed_where_free_starts_leave_three_times_the_loss(
    systems, problem, times, lost
):
    system, old = systems["linear machine"], problem.objective
    free = Objective(old.predictor, system.model, old.scale, Loss(free_starts={"i_d": 1.0}))
    fits = (
        replace(problem, objective=free)
        .climb(Plan((Stage(3, Scripted([0.01])), Stage(7, Scripted([0.01])))), system.raw)
        .fits
    )
    short, long = (
        replace(
            rung, solution=replace(rung.solution, terms=replace(rung.solution.terms, loss=loss))
        )
        for rung, loss in zip(fits, (1e-4, times * 1e-4), strict=True)
    )
    assert strayed([short, long]) == lost
    assert not strayed([long, short])
    assert not strayed([replace(one, objective=old) for one in (short, long)])


@pytest.mark.parametrize(
    ("times", "outcome", "begins_anew"),
    [
        (2.9, CONVERGED, False),
        (3.1, CONVERGED, True),
        (2.9, "The evaluations are used up.", True),
    ],
)
def test_training_begins_anew_where_the_next_windows_err_much_more(
    systems, problem, times, outcome, begins_anew
):
    """From the better of the two: the next horizon's loss at the start of all is the least here."""
    system, old = systems["linear machine"], problem.objective
    free = Objective(old.predictor, system.model, old.scale, Loss(free_starts={"i_d": 1.0}))
    freed, away = replace(problem, objective=free), system.raw + 0.1
    ends = freed.solutions(Plan((Stage(7, Scripted([0.0])),)), away)
    loss = next(ends)[1].terms.loss

    @dataclass
    class Ending:
        begun: list

        def minimise(self, problem, raw, progress):
            self.begun.append(raw)
            terms = problem.gauss_newton(raw)
            return Solution(raw + 0.1, replace(terms, loss=loss / times), 1, outcome)

    begun = []
    plan = Plan((Stage(3, Ending(begun)), Stage(7, Ending(begun))))
    list(freed.solutions(plan, system.raw))
    np.testing.assert_allclose(begun[1], system.raw if begins_anew else away, rtol=1e-12)


def test_each_horizon_begins_where_it_is_told(problem, systems):
    """And where nothing is told, where the last one ended."""
    raw, begun = systems["linear machine"].raw, []

    class Noting:
        def minimise(self, problem, raw, progress):
            begun.append(raw)
            return Solution(raw + 0.1, problem.gauss_newton(raw), 1, CONVERGED)

    was_cold = []

    class Prior:
        def joined(self, problem, raw, cold):
            was_cold.append(cold)
            return problem, raw

    plan = Plan(tuple(Stage(h, Noting()) for h in (1, 3, 7)), learned_prior=Prior())
    list(replace(problem, begun={1: raw + 1e-3, 7: raw + 2e-3}).solutions(plan, raw))
    np.testing.assert_allclose(begun, [raw + 1e-3, raw + 0.101, raw + 2e-3], rtol=1e-12)
    list(problem.solutions(plan, raw))
    assert was_cold == [False, False, False, True, False, False]


def test_terms_where_training_begins_are_computed_once(problem, systems):
    counted, raw = [], systems["linear machine"].raw

    class Counting:
        layout = problem.objective.layout

        def gauss_newton(self, raw, windows, starts=None):
            counted.append(raw)
            return problem.objective.gauss_newton(raw, windows)

    stage = problem.problem(Stage(3, Scripted([0.0])), Plan((Stage(3, Scripted([0.0])),)))
    counting = replace(stage, objective=Counting())
    first, again = counting.gauss_newton(raw), counting.gauss_newton(raw.copy())
    other = counting.gauss_newton(1.001 * raw)
    assert again is first
    assert other.loss != first.loss
    assert counting.gauss_newton(raw) is first
    assert len(counted) == 2
    known = weakref.ref(counting)
    gc.disable()  # terms are large: they go with the problem, not when garbage is looked for
    try:
        del counting
        assert known() is None
    finally:
        gc.enable()


@pytest.mark.parametrize(("deviation", "known"), [(1.0, True), (np.inf, False)])
def test_one_step_shows_nothing_where_its_start_is_free_at_no_cost(
    systems, problem, deviation, known
):
    system, old = systems["linear machine"], problem.objective
    loss = Loss(free_starts=dict.fromkeys(("i_d", "i_q"), deviation))
    predictor = replace(old.predictor, solver=RungeKutta(EULER))
    objective = Objective(predictor, system.model, old.scale, loss)
    (rung,) = (
        replace(problem, objective=objective)
        .climb(Plan((Stage(1, Scripted([0.0])),)), system.raw)
        .fits
    )
    assert np.isfinite(rung.deviation).all() == known


def test_groups_of_a_stage_move_and_the_rest_stays(systems, problem):
    system = systems["linear machine"]
    stages = (Stage(1, Scripted([0.5]), ("magnet",)), Stage(2, Scripted([0.25]), ("physical",)))
    rungs = problem.climb(Plan(stages), system.raw).fits
    moved = rungs[-1].solution.raw - system.raw
    np.testing.assert_allclose(moved, [0.25, 0.25, 0.25, 0.5], rtol=1e-12)


def test_a_group_that_the_model_has_not_is_refused(systems, problem):
    stage = Stage(1, Scripted([0.5]), ("physical", "magnets"))
    with pytest.raises(InputError, match="magnets"):
        problem.climb(Plan((stage,)), systems["linear machine"].raw)


def test_a_divergence_ends_the_climb_with_the_rungs_before_it(systems, problem):
    script = Scripted([0.0, None, 0.0])
    stages = tuple(Stage(h, script) for h in (1, 3, 7))
    rungs = problem.climb(Plan(stages), systems["linear machine"].raw).fits
    assert [rung.horizon for rung in rungs] == [1]
    assert len(script.calls) == 2


def test_a_divergence_at_the_first_rung_is_told_in_a_sentence(systems, problem):
    with pytest.raises(InputError, match=r"diverge already at horizon 3; check the units"):
        problem.climb(Plan((Stage(3, Scripted([None])),)), systems["linear machine"].raw)


def test_the_observer_hears_evaluations_and_rungs(systems, problem):
    system = systems["linear machine"]
    stages = tuple(Stage(h, Scripted([0.0])) for h in (2, 5))
    rungs = problem.climb(Plan(stages), system.raw).fits
    events = told(problem)
    assert [e["event"] for e in events] == ["evaluation", "rung"] * 2
    evaluation, finished = events[2:]
    assert (evaluation["horizon"], evaluation["stage"], evaluation["stages"]) == (5, 2, 2)
    assert evaluation["loss"] == 1.5
    assert evaluation["parameters"]["L_q"] == pytest.approx(3e-3)
    assert evaluation["units"] == {"L_d": "H", "L_q": "H", "R": "ohm", "psi": "Vs"}
    assert finished["rmse"] == pytest.approx(np.sqrt(rungs[1].solution.terms.loss))
    assert (evaluation["rmse_unit"], finished["rmse_unit"]) == ("A", "A")
    assert finished["std"]["psi"] == pytest.approx(rungs[1].deviation[3])
    assert (finished["evaluations"], finished["outcome"]) == (4, CONVERGED)
