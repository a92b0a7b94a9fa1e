"""The check of the solver: aliases are left behind, rates beyond the samples refused."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from penode import Experiment, Model, identify, ladder_plan, physical
from penode.engine import Positive, default_plan
from penode.horizon import as_recorded, hold_check, solver_check
from penode.horizon.as_recorded import Climbed, climbed_as_recorded, examined
from penode.horizon.free_runs import with_free_runs
from penode.horizon.hold_check import with_hold
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.selection import Longest, Plateau, believable, choose
from penode.horizon.solver_check import (
    MOST,
    Coarseness,
    substeps,
    too_coarse,
)
from penode.predictors.holds import FirstOrderHold, ZeroOrderHold
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import AB2, EULER, RK4

pytestmark = pytest.mark.usefixtures("quickly_compiled")


class Lag(Model):
    """x' = -a x + b u."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("V",)

    a: object = physical("1/s", Positive())
    b: object = physical("V/s", Positive())

    def derivative(self, x, u):
        return (self.b * u[0] - self.a * x[0])[None]


class Follower(Model):
    """x' = a (u - x)."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("V",)

    a: object = physical("1/s", Positive())

    def derivative(self, x, u):
        return (self.a * (u[0] - x[0]))[None]


def recorded(a, b, step, samples=600, noise=0.01):
    """Return the exact response to steps five samples long, and noise."""
    random = np.random.default_rng(0)
    u, x, kept = (
        np.repeat(random.normal(size=samples // 5), 5),
        np.zeros(samples),
        np.exp(-a * step),
    )
    for k in range(samples - 1):
        x[k + 1] = kept * x[k] + (1 - kept) * b / a * u[k]
    return Experiment("run", step, {"u": u, "x": x + noise * x.std() * random.normal(size=samples)})


def climber(model, run, selector):
    """Return what `penode.identify` hands to the check."""

    def climbed(plan, begun=None):
        problem = LadderProblem.of(model, [run], plan, ignore_events)
        problem.begun.update(begun or {})
        climb = problem.climb(plan, problem.objective.layout.raw(model))
        climb = believable(with_free_runs(problem, climb))
        return Climbed(problem, plan, climb, choose(selector, climb, plan))

    return climbed


def value(found, name="a"):
    names = found.problem.objective.layout.physical
    return found.climb.fits[found.choice.index].values[names.index(name)]


# --- a state of 1e-9 whose rate is started in the basin of an alias -----------------------------

PLAN = ladder_plan((8, 30, 120))


@pytest.fixture(scope="module")
def alias():
    return climber(Lag(50.0, 1e-8), recorded(0.506, 1e-9, 0.05), Longest())


def test_an_alias_is_left_behind(alias):
    """R(z) = 0.975 of RK4 at z = 0.0253, where it is right, and at 2.77."""
    assert value(alias(PLAN)) == pytest.approx(55.37, abs=0.02)
    found = climbed_as_recorded(PLAN, alias)
    assert value(found) == pytest.approx(0.506, rel=0.05)
    assert 1 < substeps(found.plan.solver) <= MOST
    assert found.objections == ()


def test_an_alias_of_a_solver_that_was_asked_for_is_refused(alias):
    found = examined(alias(PLAN))
    assert found.plan == PLAN
    (objection,) = found.objections
    assert objection.name == "solver too coarse"
    assert "sub-steps" in objection.repair


# --- a rate that is gone before the next sample -------------------------------------------------


def test_a_rate_beyond_the_samples_is_refused():
    """RK4 alone gives 26.6, where its damping is greatest: 1.6 over the sampling interval."""
    climbed = climber(Follower(1.0), recorded(1000.0, 1000.0, 0.06), Plateau())
    plan = ladder_plan((1, 4, 16))
    asked = examined(climbed(plan))
    assert value(asked) == pytest.approx(1.596 / 0.06, rel=0.01)
    assert [one.name for one in asked.objections] == ["solver too coarse"]
    (objection,) = climbed_as_recorded(plan, climbed).objections
    assert objection.name == "faster than the samples"
    assert objection.reason.startswith("a may be any number from this one up")


# --- to first order ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def coarse():
    """Return a fit by Euler's method, a tenth of a time constant long."""
    plan = replace(ladder_plan((1, 4, 16)), solver=RungeKutta(EULER))
    climbed = climber(Lag(1.0, 1.0), recorded(2.0, 3.0, 0.05), Longest())
    return plan, climbed


def test_a_shift_is_what_training_with_a_finer_solver_gives(coarse):
    plan, climbed = coarse
    found = climbed(plan)
    _, step, moved, _ = solver_check._doubled(found.problem, plan, found.climb.fits[2])
    again = climbed(replace(plan, solver=Substeps(RungeKutta(EULER), 2)))
    change = again.climb.fits[2].values[:2] - found.climb.fits[2].values[:2]
    np.testing.assert_allclose(moved, change, rtol=0.1)
    slopes = found.problem.reported.jacobian(found.climb.fits[2].solution.raw)[:2]
    np.testing.assert_allclose(slopes @ step, moved)
    assert change[0] > 0.03


@pytest.mark.parametrize(("start", "kept"), [(Lag(0.5, 0.5), True), (Lag(1.6, 2.4), False)])
def test_an_end_that_moves_much_is_left_for_a_start_that_a_finer_solver_predicts_better_by(
    start, kept
):
    """Euler's rate at samples 0.8 time constants apart is a third off: no step leads on."""
    plan = replace(ladder_plan((1, 4, 16)), solver=RungeKutta(EULER))
    found = examined(climber(start, recorded(2.0, 3.0, 0.4), Longest())(plan))
    ends = {rung.horizon: rung.solution.raw for rung in found.climb.fits}
    assert (found.begun is not None) is kept
    if kept:
        for horizon, raw in ends.items():
            np.testing.assert_array_equal(found.begun[horizon], raw)


def test_a_solver_is_refined_until_it_does_not_matter_or_no_further(coarse, monkeypatch):
    plan, climbed = coarse
    monkeypatch.setattr(solver_check, "MOST", 2)
    found = climbed_as_recorded(plan, climbed)
    assert found.plan.solver == Substeps(RungeKutta(EULER), 2)
    (objection,) = found.objections
    assert "moves by" in objection.reason
    assert objection.repair.startswith("More than 2 sub-steps are needed.")
    assert "stiff" not in objection.repair


def test_each_horizon_goes_on_from_where_it_ended(coarse, alias):
    """The chosen one a step on; after an alias, from the start."""
    plan, climbed = coarse
    found = examined(climbed(plan))
    chosen = found.climb.fits[found.choice.index].horizon
    for rung in found.climb.fits:
        at = found.coarse.near if rung.horizon == chosen else rung.solution.raw
        np.testing.assert_array_equal(found.begun[rung.horizon], at)
    asked = []

    def noted(plan, begun):
        asked.append(begun)
        return climbed(plan, begun)

    climbed_as_recorded(plan, noted)
    assert asked[0] is None
    assert set(asked[1]) == {stage.horizon for stage in plan.stages}
    assert examined(alias(PLAN)).begun is None
    assert examined(climbed(ladder_plan((1, 4, 16)))).begun is None


@pytest.mark.parametrize(("step", "finer"), [(0.3, True), (0.1, False), (0.5, False)])
def test_a_solver_is_refined_before_the_first_climb(step, finer):
    """A step of nine tenths of a time constant, of three, and one whose solver makes an alias."""
    run, start = recorded(3.0, 3.0, step), Start(Follower(2.0))
    plan = default_plan(start.model, [run])
    fine = with_hold(plan, start, [run])
    assert (fine.solver.count > 1) is finer
    assert fine.hold == ZeroOrderHold()
    if finer:
        found = climber(start.model, run, Longest())(fine)
        assert examined(found).coarse is None


@pytest.mark.parametrize(("near", "count"), [(np.zeros(1), 8), (None, 1)])
def test_a_solver_that_may_have_made_an_alias_is_left_to_the_climb(near, count, monkeypatch):
    found = Coarseness(Substeps(RungeKutta(RK4), 1), 8, "", 0.1, near)
    monkeypatch.setattr(hold_check, "too_coarse", lambda *given: found)
    run, start = recorded(3.0, 3.0, 0.1), Start(Follower(2.0))
    assert with_hold(default_plan(start.model, [run]), start, [run]).solver.count == count


def test_a_fine_solver_stays(coarse):
    _, climbed = coarse
    plan = ladder_plan((1, 4, 16))
    found = climbed_as_recorded(plan, climbed)
    assert found.plan is plan
    assert found.objections == ()


def test_solvers_that_start_from_several_samples_are_not_examined(coarse):
    _, climbed = coarse
    found = climbed(replace(ladder_plan((1,)), solver=AdamsBashforth(AB2)))
    assert too_coarse(found.problem, found.plan, found.climb, found.choice) is None


def test_a_stiff_model_is_told_of_implicit_solvers():
    told = Coarseness(RungeKutta(RK4), 4, "It moves.", stiffness=3.0)
    assert told.finer == Substeps(RungeKutta(RK4), 4)
    assert told.objection.repair.startswith("Take 4 sub-steps a sample (Substeps).")
    assert "ImplicitMidpoint or Trapezoidal" in told.objection.repair


def test_a_rung_whose_learned_part_has_a_prior_is_predicted_by_the_finer_solver_too(coarse):
    plan, climbed = coarse
    found = climbed(plan)
    problem, rung = found.problem, found.climb.fits[1]
    problem = replace(problem, objectives={rung.horizon: problem.objective})
    finer = replace(plan, solver=Substeps(RungeKutta(EULER), 2))
    again = problem.with_predictor(finer, rung)
    assert again.objective.predictor.solver == finer.solver
    assert again.windows.inputs.shape[1] == 2  # what each sub-step reads
    assert again.gauss_newton(rung.solution.raw).loss != rung.solution.terms.loss


def test_a_wrong_hold_is_exchanged_and_the_ladder_climbed_again(coarse):
    plan, climbed = ladder_plan((1, 4, 16)), coarse[1]
    found = climbed_as_recorded(replace(plan, hold=FirstOrderHold()), climbed)
    assert found.plan.hold == ZeroOrderHold()
    np.testing.assert_allclose(found.climb.fits[2].values[:2], [2.0, 3.0], rtol=0.02)


FLIPPED = [FirstOrderHold(), ZeroOrderHold()]


@pytest.mark.parametrize(
    ("less", "wanted", "taken"),
    [(0.5, FLIPPED, 2), (0.5, FLIPPED[:1], 1), (0.95, FLIPPED, 1), (0.5, [], 0)],
)
def test_after_another_hold_that_leaves_much_less_it_is_asked_once_more(
    coarse, monkeypatch, less, wanted, taken
):
    """What another one was better by may have been a better minimum; then there is an end."""
    plan, climbed = replace(ladder_plan((4,)), solver=Substeps(RungeKutta(RK4), 2)), coarse[1]
    holds, losses = [*wanted, *[None] * (2 - len(wanted))], iter((less, 1.0, less**2, less))
    monkeypatch.setattr(Climbed, "loss_at", lambda self, index: next(losses))

    def better(problem, plan, rung):
        hold = holds.pop(0)  # fails where it is asked a third time
        return hold and (replace(plan, hold=hold), rung.solution.raw)

    monkeypatch.setattr(as_recorded, "better_hold", better)
    found = climbed_as_recorded(plan, climbed)
    assert found.plan.hold == (wanted[taken - 1] if taken else plan.hold)


@pytest.mark.parametrize("check", ["better_hold", "too_coarse"])
def test_an_interrupted_check_leaves_a_stopped_fit(coarse, monkeypatch, check):
    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(as_recorded, check, interrupted)
    found = climbed_as_recorded(ladder_plan((1, 4, 16)), coarse[1])
    assert found.climb.interrupted
    assert found.choice.verdict == "stopped"
    assert found.choice.reason.startswith("The check of hold and solver was interrupted.")


@pytest.mark.slow
def test_the_default_path_leaves_an_alias_behind():
    fit = identify(Lag(1.0, 1.0), [recorded(0.506, 1e-9, 0.05, samples=300)])
    assert fit.parameters["a"].value == pytest.approx(0.506, rel=0.1)
