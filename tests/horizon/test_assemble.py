"""From rungs and a choice to a fit: estimates, verdict, warnings."""

import time
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from tests.horizon.test_default_plan import Lag
from tests.horizon.test_simulation import lag

from penode import Experiment, Model, Plan, Stage, Start, identify, ladder_plan, physical
from penode.arrays import Leaf
from penode.data.windows import Contiguous, Jittered
from penode.horizon.assemble import Assembly
from penode.horizon.consensus import Consensus
from penode.horizon.free_runs import with_free_runs
from penode.horizon.ladder import Climb, LadderProblem
from penode.horizon.selection import Choice
from penode.horizon.uncertainty_budget import Imperfection
from penode.models.polynomials import Polynomial
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.covariance import Reported, reported_covariance
from penode.training.loss import Loss, equation, last_step
from penode.training.plan import Solution
from penode.training.residuals import Objective


class Still:
    """An optimiser that leaves everything where it is."""

    def minimise(self, problem, raw, progress):
        return Solution(raw, problem.gauss_newton(raw), 3, "Still.")


@pytest.fixture(scope="module")
def climbed(systems, objective_of):
    """Return a problem of the linear machine and two rungs made of its true parameters."""
    system = systems["linear machine"]
    objective, runs = objective_of(system), system.recorded_again(noise=0.05)
    reported = Reported(objective.layout, np.zeros((1, 2)))
    problem = LadderProblem(objective, reported, system.model, runs, observer=lambda event: None)
    climb = problem.climb(Plan((Stage(1, Still()), Stage(7, Still()))), system.raw)
    return problem, with_free_runs(problem, climb).fits


def fit_of(climbed, start=None, choice=None, values=None):
    problem, rungs = climbed
    if values is not None:
        rungs = [replace(r, values=np.array(v)) for r, v in zip(rungs, values, strict=True)]
    start = start or Start(problem.model)
    choice = choice or Choice(1, "plateau", "Because.", (0, 1), averaged=True)
    plan = Plan((Stage(1, Still()), Stage(7, Still())))
    return Assembly(problem, start, plan, rungs, choice).fit((), time.monotonic())


def test_estimates_of_a_plateau_are_those_of_its_rungs_together(climbed):
    fit, known = fit_of(climbed), Consensus.of(climbed[1])
    assert list(fit.parameters) == ["L_d", "L_q", "R", "psi"]
    for k, (name, unit) in enumerate([("L_d", "H"), ("L_q", "H"), ("R", "ohm"), ("psi", "Vs")]):
        estimate = fit.parameters[name]
        assert estimate.value == pytest.approx(known.values[k])
        assert estimate.std == pytest.approx(known.deviation[k])
        assert estimate.unit == unit
        low, high = estimate.interval_95
        assert high - low == pytest.approx(2 * 1.96 * estimate.std)
        assert (high + low) / 2 == pytest.approx(estimate.value)
        assert estimate.identifiability is None


def test_the_estimate_of_the_selected_rung_is_less_sure_by_half_the_spread(climbed):
    rungs = climbed[1]
    there, away = np.array([2e-3, 3e-3, 0.2, 0.05]), np.array([2e-3, 3e-3, 0.21, 0.05])
    choice = Choice(1, "plateau", "Because.", (0, 1))
    fit = fit_of(climbed, choice=choice, values=[away, there])
    own = reported_covariance(rungs[1].influence, rungs[1].series.lags) + rungs[1].prior
    first, second = (one.deviation[2] ** -2 for one in rungs[:2])
    apart = 0.01 * np.sqrt(first * second) / (first + second)  # of two points with weights
    assert fit.parameters["R"].value == fit.model.R == 0.2
    assert fit.parameters["R"].std == pytest.approx(np.sqrt(own[2, 2] + apart**2 / 2))
    assert fit.parameters["psi"].std == pytest.approx(np.sqrt(own[3, 3]))


FIXED = Choice(1, "fixed", "Asked for.", (1,))


def test_estimates_of_a_fixed_horizon_are_its_own(climbed):
    fit, rung = fit_of(climbed, choice=FIXED), climbed[1][1]
    for k, estimate in enumerate(fit.parameters.values()):
        assert estimate.value == pytest.approx(rung.values[k])
        own = reported_covariance(rung.influence, rung.series.lags) + rung.prior
        assert estimate.std == pytest.approx(np.sqrt(own[k, k]))


def test_the_reported_model_has_the_reported_parameters(climbed):
    there, away = np.array([2e-3, 3e-3, 0.2, 0.05]), np.array([2e-3, 3e-3, 0.21, 0.05])
    fit = fit_of(climbed, values=[away, there])
    assert 0.2 < fit.parameters["R"].value < 0.21
    for name, estimate in fit.parameters.items():
        assert getattr(fit.model, name) == pytest.approx(estimate.value)


def test_a_mean_beside_a_bent_valley_is_not_reported(climbed):
    """Far outside the joint region of the rung that was chosen: the rung itself is."""
    there, away = np.array([2e-3, 3e-3, 0.2, 0.05]), np.array([2e-3, 3e-3, 0.3, 0.05])
    fit = fit_of(climbed, values=[away, there])
    assert fit.parameters["R"].value == 0.2
    assert fit.parameters["R"].std > climbed[1][1].deviation[2]


class Sagging(Lag):
    """The same with a polynomial beside it, linear in its coefficients."""

    curve: Polynomial

    def derivative(self, x, u):
        return super().derivative(x, u) + self.learned(x)

    def learned(self, x):
        return self.curve.value_and_jacobian(x)[0]


def test_the_map_beside_a_bent_valley_is_the_chosen_rungs():
    model, plan = Sagging(2.0, Polynomial.zero(1, 1, 2)), ladder_plan((1, 4))
    problem = LadderProblem.of(model, [lag()], plan, lambda event: None)
    climb = problem.climb(plan, problem.objective.layout.raw(model))
    first, second = with_free_runs(problem, climb).fits
    away = replace(first, values=first.values * 1.5)
    choice = Choice(1, "plateau", "Because.", (0, 1), averaged=True)
    fit = Assembly(problem, Start(model), plan, (away, second), choice).fit((), time.monotonic())
    assert fit.parameters["a"].value == second.values[0]
    np.testing.assert_allclose(fit.model.curve.coefficients, second.model.curve.coefficients)
    assert np.abs(first.solution.raw - second.solution.raw).max() > 1e-3


def test_what_the_rungs_of_no_plateau_differ_by_widens_the_interval(climbed):
    there, away = np.array([2e-3, 3e-3, 0.2, 0.05]), np.array([2e-3, 3e-3, 0.3, 0.05])
    spread = Choice(1, "no plateau", "It depends.", (0, 1))
    fit = fit_of(climbed, values=[away, there], choice=spread)
    rung = climbed[1][1]
    own = reported_covariance(rung.influence, rung.series.lags) + rung.prior
    deviation = np.sqrt(np.diag(own))
    assert fit.parameters["R"].value == 0.2
    first, second = (one.deviation[2] ** -2 for one in climbed[1][:2])
    apart = 0.1 * np.sqrt(first * second) / (first + second)  # of two points with weights
    assert fit.parameters["R"].std == pytest.approx(np.hypot(deviation[2], apart))
    assert fit.parameters["psi"].std == pytest.approx(deviation[3])


def test_a_parameter_that_no_horizon_is_sure_of_is_told_so_and_spoils_no_other(climbed):
    problem, rungs = climbed
    unsure = np.array([1.0, np.inf, 1.0, 1.0])
    rungs = [
        replace(rung, deviation=rung.deviation * unsure, working=rung.working * unsure)
        for rung in rungs
    ]
    fit = fit_of((problem, rungs))
    assert np.isinf(fit.parameters["L_q"].std)
    assert fit.parameters["R"].std == pytest.approx(Consensus.of(climbed[1]).deviation[2])


def test_one_step_matrices_are_kept_where_k_step_errors_are_filtered_one_step_errors(climbed):
    kept = fit_of(climbed).transitions
    assert kept.shape == (64, 2, 2)
    assert np.abs(np.linalg.eigvals(kept)).max() < 1.0
    problem, rungs = climbed

    def of(loss):
        objective = Objective(problem.objective.predictor, problem.model, np.full(2, 3.0), loss)
        return fit_of((replace(problem, objective=objective), rungs))

    for loss in (Loss(weight=last_step), Loss(domain=equation)):
        assert not of(loss).transitions.size
        assert not of(loss).starts.size
    free = of(Loss(free_starts={"i_d": 2.0}))
    assert free.transitions.shape == kept.shape
    np.testing.assert_allclose(free.starts, [9 / 4, np.inf])
    assert np.isinf(of(Loss()).starts).all()


def test_the_ladder_is_told_rung_by_rung(climbed):
    horizon, rungs = fit_of(climbed).horizon, climbed[1]
    assert (horizon.selected, horizon.verdict, horizon.reason) == (7, "plateau", "Because.")
    assert horizon.plateau == (1, 7)
    assert horizon.answered
    for told, rung in zip(horizon.ladder, rungs, strict=True):
        assert told.horizon == rung.horizon
        assert told.parameters["R"] == pytest.approx(0.2)
        assert told.std["R"] == pytest.approx(rung.deviation[2])
        assert told.rmse == pytest.approx(np.sqrt(rung.solution.terms.loss))
        assert (told.iterations, told.outcome) == (3, "Still.")
    assert horizon.ladder[0].free_run_rmse == pytest.approx(0.05, rel=0.1)


def test_an_indistinguishable_parameter_overrules_the_verdict(climbed):
    start = Start(climbed[0].model, {"R": 2e-4, "psi": 0.5}, repair="Reverse the speed.")
    fit = fit_of(climbed, start)
    assert fit.horizon.verdict == "not identifiable"
    assert not fit.horizon.answered
    sentence = (
        "These data cannot distinguish R (2.0e-04 of it is its own) from the learned map. "
        "Reverse the speed."
    )
    assert fit.horizon.reason == sentence
    assert fit.warnings == (sentence,)
    assert fit.parameters["R"].identifiability == 2e-4
    assert fit.parameters["psi"].identifiability == 0.5


def test_a_diverging_free_run_is_a_warning_and_no_number(climbed):
    problem, rungs = climbed
    wrong = np.array([0.0, 0.0, -200.0, 0.0])
    solution = replace(rungs[1].solution, raw=rungs[1].solution.raw + wrong)
    broken = replace(rungs[1], values=rungs[1].values + wrong, solution=solution)
    known = with_free_runs(problem, Climb((rungs[0], broken))).fits
    fit = fit_of((problem, known), choice=FIXED)
    assert fit.horizon.ladder[0].free_run_rmse is not None
    assert fit.horizon.ladder[1].free_run_rmse is None
    assert [w.split(":")[0] for w in fit.warnings] == ["run0.csv", "run1.csv"]
    assert all("free run diverges" in w for w in fit.warnings)


def test_provenance_names_versions_and_data(oscillator):
    provenance = oscillator.fit.provenance
    assert set(provenance["versions"]) == {"penode", "jax", "numpy", "scipy", "optax"}
    assert set(provenance["data"]) == {"train.csv", "unseen.csv"}
    assert provenance["placement"] == str(Jittered())
    assert provenance["training_time_s"] > 0


#: What reports the mean of a plateau, what one horizon says, and what none is sure of.
CHOICES = {
    "mean": Choice(1, "plateau", "Because.", (0, 1), averaged=True),
    "one": FIXED,
    "around": Choice(1, "no plateau", "They differ.", (0, 1)),
}


def scaled(name, factor):
    """Return an imperfection that multiplies a channel."""

    def applied(experiment, number):
        values = experiment.channels[name] * (1 + factor * number)
        return replace(experiment, channels={**experiment.channels, name: values})

    return Imperfection(f"gain of {name}", "1 %", "Calibrate.", applied)


@pytest.mark.parametrize("choice", CHOICES.values(), ids=CHOICES)
@pytest.mark.parametrize("assumed", [(), (scaled("u_d", 0.01), scaled("u_q", 0.01))])
def test_the_covariance_is_that_of_the_deviations_reported(climbed, choice, assumed):
    values = [np.add(rung.values, [0, 0, 1e-3, -1e-4]) for rung in climbed[1]]
    values[1] = climbed[1][1].values
    fit = fit_of(climbed, Start(climbed[0].model, imperfections=assumed), choice, values)
    deviation = [one.std for one in fit.parameters.values()]
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), deviation, rtol=1e-10)
    np.testing.assert_allclose(fit.covariance, fit.covariance.T, rtol=1e-10)
    assert np.linalg.eigvalsh(fit.correlation).min() > -1e-12
    frame = fit.correlation_frame()
    assert frame.columns == ["parameter", *fit.parameters]
    np.testing.assert_array_equal(frame.drop("parameter").to_numpy(), fit.correlation)
    of_resistance = fit.result()["covariance"]["R"]
    assert of_resistance["psi"] == fit.covariance[2, 3]


def test_what_rungs_and_imperfections_move_together_is_correlated(climbed):
    """Two rungs apart by one vector, and one imperfection, each add a matrix of rank one."""
    apart, (problem, rungs) = np.array([0, 0, 2e-3, -3e-4]), climbed
    one = scaled("u_q", 0.05)
    silent = fit_of(climbed, choice=CHOICES["around"])
    values = [rungs[1].values + apart, rungs[1].values]
    wide = fit_of(climbed, choice=CHOICES["around"], values=values)
    added = (wide.covariance - silent.covariance)[2:, 2:]
    # Each parameter has weights of its own.
    assert added[0, 1] == pytest.approx(-np.sqrt(added[0, 0] * added[1, 1]), rel=0.03)
    moved = fit_of(climbed, Start(problem.model, imperfections=(one,)), CHOICES["around"])
    rank = np.linalg.svd(moved.covariance - silent.covariance, compute_uv=False)
    assert rank[1] < 1e-6 * rank[0]


def test_what_a_parameter_of_unknown_deviation_shares_is_not_known(climbed):
    problem, rungs = climbed
    unsure = np.array([1.0, np.inf, 1.0, 1.0])
    rungs = [
        replace(rung, deviation=rung.deviation * unsure, working=rung.working * unsure)
        for rung in rungs
    ]
    known = np.ones((4, 4), dtype=bool)
    known[1] = known[:, 1] = False
    fit = fit_of((problem, rungs))
    np.testing.assert_array_equal(np.isfinite(fit.correlation), known)
    assert np.isinf(fit.covariance[1, 1])


class Leaky(Model):
    """x' = b u - a x."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("V",)

    a: Leaf = physical("1/s")
    b: Leaf = physical("1/s")

    def derivative(self, x, u):
        return (self.b * u[0] - self.a * x[0])[None]


def test_white_noise_in_every_step_gives_the_covariance_of_linear_regression():
    """But for what deviations are reported larger by, see `reported_covariance`: 1.09 squared."""
    ratios = np.mean([beside_regression(seed) for seed in range(12)], axis=0)
    np.testing.assert_allclose(ratios, 1.09**2, rtol=0.12)


def beside_regression(seed):
    """Return the covariance of a fit of one draw of noise over that of linear regression."""
    step, count, noise, random = 0.01, 6000, 0.01, np.random.default_rng(seed)
    u = 1.0 + np.repeat(random.normal(size=count // 50), 50)
    x = np.zeros(count)
    for k in range(count - 1):
        x[k + 1] = x[k] + step * (2.0 * u[k] - 1.5 * x[k]) + noise * random.normal()
    plan = replace(ladder_plan((1,)), solver=RungeKutta(EULER), placement=Contiguous())
    fit = identify(Leaky(1.0, 1.0), [Experiment("run", step, {"x": x, "u": u})], plan=plan)
    regressors = step * np.stack([-x, u], axis=1)[:-1]
    wanted = noise**2 * np.linalg.inv(regressors.T @ regressors)
    correlation = wanted[0, 1] / np.sqrt(wanted[0, 0] * wanted[1, 1])
    assert correlation > 0.5
    assert fit.correlation[0, 1] == pytest.approx(correlation, abs=0.15)
    return fit.covariance / wanted
