"""What the model leaves out: found where it is, nothing where residuals are noise."""

from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import brentq

from penode import Experiment, Model, identify, ladder_plan, physical
from penode.arrays import Leaf
from penode.data.windows import Windows
from penode.engine import Loss, Positive
from penode.horizon import discrepancy
from penode.horizon.consensus import LEFT_OUT
from penode.horizon.discrepancy import what_is_left_out
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.models.discrepancy import spline_basis
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.holds import FirstOrderHold
from penode.training.evidence import Information, Rows
from penode.training.plan import Problem

MASS, DAMPING, STEP, SAMPLES, NOISE = 1.3, 0.4, 0.05, 1500, 0.01


class Mass(Model):
    """q' = v, mass v' = u - damping v - q."""

    states: ClassVar[tuple[str, ...]] = ("q", "v")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s")

    mass: Leaf = physical("kg", Positive())
    damping: Leaf = physical("Ns/m")

    def derivative(self, x, u):
        return jnp.stack([x[1], (u[0] - self.damping * x[1] - x[0]) / self.mass])


def recorded(friction, seed=1, drive=None):
    """Return a recording with noise, of a mass with friction beside the damping."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.normal(0.0, 2.0, SAMPLES // 15), 15)
    u = u if drive is None else drive

    def rate(x, force):
        lost = DAMPING * x[1] + friction * np.tanh(x[1] / 0.02)
        return np.array([x[1], (force - lost - x[0]) / MASS])

    x, states, h = np.zeros(2), np.empty((SAMPLES, 2)), STEP / 10
    for k, force in enumerate(u):
        states[k] = x
        for _ in range(10):
            x = x + h * rate(x + h / 2 * rate(x, force), force)
    states += NOISE * random.normal(size=states.shape)
    return Experiment("run", STEP, {"q": states[:, 0], "v": states[:, 1], "u": u})


PLAN = replace(ladder_plan((4,)), loss=Loss(free_starts={"q": None, "v": None}))


def climbed(run):
    problem = LadderProblem.of(Mass(1.0, 0.1), [run], PLAN, ignore_events)
    return problem, problem.climb(PLAN, problem.objective.layout.raw(Mass(1.0, 0.1))).fits


def deviations_left_out(problem, plan, fits):
    return np.sqrt(np.diag(what_is_left_out(problem, plan, fits, 0)))


@pytest.mark.slow
def test_friction_left_out_widens_what_it_stands_in_for():
    problem, fits = climbed(recorded(friction=0.3))
    added = deviations_left_out(problem, PLAN, fits)
    gap = np.abs(fits[0].values - [MASS, DAMPING])
    own = fits[0].deviation
    assert gap[1] > 5 * own[1]
    assert gap[1] < 2.5 * np.hypot(own, added)[1]
    assert added[1] < 3 * gap[1]
    assert added[0] < 0.2 * added[1]


SLOW = pytest.mark.slow


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=SLOW), pytest.param(3, marks=SLOW)])
def test_nothing_is_left_out_where_residuals_are_noise(seed):
    problem, fits = climbed(recorded(friction=0.0, seed=seed))
    assert np.all(deviations_left_out(problem, PLAN, fits) < 0.3 * fits[0].deviation)


def test_recordings_too_short_to_show_it_add_nothing():
    run = recorded(friction=0.3)
    short = Experiment("short", STEP, {k: v[:30] for k, v in run.channels.items()})
    problem, fits = climbed(short)
    assert not what_is_left_out(problem, PLAN, fits, 0).any()


@pytest.mark.parametrize(("friction", "looked_at"), [(0.3, True), (0.0, False)])
def test_it_is_looked_for_where_the_error_grows_with_the_horizon(friction, looked_at, monkeypatch):
    run, asked = recorded(friction), []
    plan = replace(ladder_plan((4, 20, 80)), loss=PLAN.loss)
    problem = LadderProblem.of(Mass(1.0, 0.1), [run], plan, ignore_events)
    fits = problem.climb(plan, problem.objective.layout.raw(Mass(1.0, 0.1))).fits
    monkeypatch.setattr("penode.horizon.discrepancy._Beside.of", lambda *given: asked.append(given))
    assert not what_is_left_out(problem, plan, fits, 1).any()
    assert bool(asked) == looked_at


def test_what_data_know_of_some_directions_alone_has_an_evidence_of_each_part(rng):
    """Rounding leaves others below zero, by more than a weak belief adds to them."""
    known = rng.normal(size=(9, 3)) * 10.0 ** np.arange(9)[:, None]
    matrix = known @ known.T
    matrix -= 1e-14 * np.diag(np.diag(matrix))
    data = Information(matrix, known @ rng.normal(size=3), 1.0)
    shape = np.eye(3)
    belief = discrepancy._Belief(data, np.array([0.0, 1e3, 1e3]), np.stack([shape] * 3), 6, 2)
    (gain, better), *_ = belief.with_one([0], [shape])
    assert np.isfinite(gain)
    assert np.isfinite(better.adds(np.ones((2, 9)))).all()


def test_it_is_not_looked_for_where_starts_may_take_of_the_noisiest_sensor():
    """A start of two states spends two of eight values, and of unlike sensors the larger errors."""
    problem, (rung,) = climbed(recorded(friction=0.0))

    def grows(short, long, between=1.0):
        rungs = []
        for horizon, loss in ((4, short), (20, between), (80, long)):
            terms = replace(rung.solution.terms, loss=loss)
            solution = replace(rung.solution, terms=terms)
            rungs.append(replace(rung, horizon=horizon, solution=solution))
        return discrepancy._error_grows(problem, rungs)

    assert not grows(1.0 - 0.9 * 2 / 8, 1.0)
    assert grows(1.0 - 0.9 * 2 / 8, 1.2)
    assert not grows(1.0 - 0.9 * 2 / 8, 1.0, between=9.0)  # training fell short there


def test_a_fit_has_a_row_for_it_in_the_budget_only_where_the_plan_asks():
    run = recorded(friction=0.3)
    start = Mass(1.0, 0.1)
    without, fit = (
        identify(start, [run], plan=replace(PLAN, discrepancy=on)) for on in (False, True)
    )
    silent, asked = (one.parameters["damping"] for one in (without, fit))
    rows = {row.source: row for row in asked.budget}
    assert LEFT_OUT not in {row.source for row in silent.budget}
    assert asked.std == pytest.approx(np.hypot(silent.std, rows[LEFT_OUT].std))
    assert rows[LEFT_OUT].remedy
    # The parameters that it is most of are named in one sentence.
    most = [
        name
        for name, estimate in fit.parameters.items()
        for row in estimate.budget
        if row.source == LEFT_OUT and row.std**2 > 0.5 * estimate.std**2
    ]
    said = f"Most of the uncertainty of {', '.join(most)} is what the model leaves out, which"
    assert "damping" in most
    assert next(one for one in fit.warnings if "leaves out" in one).startswith(said)
    assert not any("leaves out" in one for one in without.warnings)


def test_a_fit_says_where_it_is_too_large_to_be_looked_for(monkeypatch):
    monkeypatch.setattr(discrepancy, "MOST_PARAMETERS", 20)
    plan = replace(PLAN, discrepancy=True)
    fit = identify(Mass(1.0, 0.1), [recorded(friction=0.3)], plan=plan)
    assert all(LEFT_OUT not in {row.source for row in p.budget} for p in fit.parameters.values())
    assert [one for one in fit.warnings if "too many to look for" in one]


def test_splines_sum_to_one_and_stay_where_a_channel_ends():
    basis = np.asarray(spline_basis(jnp.linspace(-2.0, 2.0, 9)[None], -1.0, 1.0, 6))
    np.testing.assert_allclose(basis.sum(axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(basis[..., 0], basis[..., 2], atol=1e-6)


@pytest.mark.slow
def test_a_hold_that_prepares_inputs_between_samples_changes_little():
    """Commands that stand still for 15 samples hold nothing between them but at their steps."""
    run, added = recorded(friction=0.3), []
    for hold in (FirstOrderHold(), BandLimitedHold()):
        plan = replace(PLAN, hold=hold)
        problem = LadderProblem.of(Mass(1.0, 0.1), [run], plan, ignore_events)
        fits = problem.climb(plan, problem.objective.layout.raw(Mass(1.0, 0.1))).fits
        added.append(deviations_left_out(problem, plan, fits))
    np.testing.assert_allclose(added[1][1], added[0][1], rtol=0.3)


def test_evidence_by_eigenvalues_is_that_of_each_amplitude():
    """And so is that of one block among others, up to a constant."""
    random, size, blocks = np.random.default_rng(8), 4, 3
    spread = random.normal(size=(40, size * blocks))
    slope = random.normal(size=size * blocks) * np.repeat([3.0, 30.0, 3.0], size)
    data = Information(spread.T @ spread, slope, 1.0)
    white = random.normal(size=(6, size))

    def direct(amplitudes):
        slopes = block_diag(*(white / a for a in amplitudes))
        return Rows(slopes, np.zeros(len(slopes))).evidence(data)

    together = block_diag(*[white.T @ white] * blocks)
    found = discrepancy._evidence(data.matrix, data.slope, together)
    expected = [direct(np.full(blocks, a)) for a in discrepancy._AMPLITUDES]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)

    others, shape = np.array([0.3, 0.0, 0.1]), white.T @ white
    belief = discrepancy._Belief(data, others, np.stack([shape] * blocks), 1, 2)
    expected = np.array([direct(others + a * np.eye(blocks)[1]) for a in discrepancy._AMPLITUDES])
    ((gain, better),) = belief.with_one([1], [shape])
    assert gain == pytest.approx(expected.max() - expected[0])
    assert better.size[1] == discrepancy._AMPLITUDES[np.argmax(expected)]
    assert better.evidence == pytest.approx(direct(better.size))
    charged = better.evidence - 3 * np.log(7)  # three splines, each of seven that it might be
    assert replace(better, rivals=7).evidence == pytest.approx(charged)
    nothing = replace(belief, size=np.zeros(blocks), chosen=0, rivals=7)
    assert nothing.evidence == 0.0

    alike = discrepancy._alike(nothing, shape)
    assert len(set(alike.size)) == 1
    assert alike.evidence == pytest.approx(direct(alike.size) - np.log(7))  # one choice

    follow = random.normal(size=(2, size * blocks))
    prior = block_diag(*(shape / a**2 for a in better.size))
    covariance = np.linalg.inv(data.matrix + prior)
    shift = follow @ covariance @ data.slope
    expected = follow @ covariance @ follow.T + np.outer(shift, shift)
    np.testing.assert_allclose(better.adds(follow), expected, rtol=1e-9)


def test_past_inputs_are_changes_and_lags_that_begin_settled_in_each_recording(rng):
    inputs = rng.normal(size=(70, 2))  # one input, and what a hold prepared between samples
    windows = Windows(np.zeros((70, 1)), inputs, np.array([0]), np.array([0]), 4, 1, 0.1)
    got = discrepancy._with_past(replace(windows, begins=np.array([0, 30])), 1).inputs
    got = got.reshape(70, 2, 4)
    expected = np.empty_like(got)
    for first, last in ((0, 30), (30, 70)):
        short = long = inputs[first]
        for k in range(first, last):
            a, b = np.exp(-1 / 3), np.exp(-1 / 3.5)  # a tenth of 35 samples
            short, long = a * short + (1 - a) * inputs[k], b * long + (1 - b) * inputs[k]
            change = inputs[k] - inputs[max(k - 1, first)]
            expected[k] = np.stack([inputs[k], change, short, long], axis=1)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)


def test_a_mode_left_out_is_seen_in_past_inputs():
    """A store takes part of the input and gives it back late, as no function of today does."""
    run = recorded(friction=0.0)
    u, late = run.channels["u"], 0.0
    acting = np.empty_like(u)
    for k in range(len(u)):
        late += (u[k] - late) * STEP / 0.5
        acting[k] = 0.8 * u[k] + 0.2 * late
    plant = recorded(friction=0.0, drive=acting)
    problem, fits = climbed(Experiment("store", STEP, {**plant.channels, "u": u}))
    gap = np.abs(fits[0].values - [MASS, DAMPING])
    assert (gap > 3 * fits[0].deviation).any()
    added = deviations_left_out(problem, PLAN, fits)
    assert (gap < 2 * np.hypot(fits[0].deviation, added)).all()


def test_a_spline_that_data_know_to_be_tiny_does_not_enter(rng):
    """Its evidence is large at the least amplitude already, which is as good as zero."""
    shape = np.eye(9)
    data = Information(1e16 * np.eye(18), 1e9 * rng.normal(size=18), 1.0)
    nothing = discrepancy._Belief(data, np.zeros(2), np.stack([shape] * 2), 2)
    ((gain, better),) = nothing.with_one([0], [shape])
    assert discrepancy._evidence(data.matrix[:9, :9], data.slope[:9], shape).max() > 10
    assert gain == 0.0
    assert not better.there.any()
    assert not discrepancy._one_by_one(nothing, [shape]).there.any()


@pytest.mark.parametrize(("gain", "enters"), [(0.95, False), (1.05, True)])
def test_a_spline_enters_for_more_than_the_price_of_its_choice(gain, enters):
    """The price is the logarithm of how many it was chosen from."""
    count, shape = 6, np.eye(9)
    nothing = discrepancy._Belief(None, np.zeros(count), np.stack([shape] * count), 2 * count)
    data = Information(1e4 * np.eye(9 * count), np.zeros(9 * count), 1.0)

    def added(size):
        data.slope[:9] = size
        found = replace(nothing, data=data)
        return found.with_one([0], [shape])[0][0], found

    size = brentq(lambda size: added(size)[0] - gain * np.log(2 * count), 1.0, 1e4)
    assert discrepancy._one_by_one(added(size)[1], [shape]).there.any() == enters


def test_nothing_is_believed_once(rng):
    """Functions whose likeliest size is zero are none, however many were offered."""
    data = Information(1e4 * np.eye(72), rng.normal(size=72), 1.0)
    (nothing,) = discrepancy._beliefs(data, 8)
    assert not nothing.there.any()


def test_starts_are_looked_for_from_where_training_had_them(monkeypatch):
    """Starts of a chaotic plant have other minima, whose residuals say nothing of this fit."""
    problem, (rung,) = climbed(recorded(friction=0.0))
    begun, gauss_newton = [], Problem.gauss_newton

    def noted(self, raw, near=None):
        begun.append(near)
        return gauss_newton(self, raw, near)

    monkeypatch.setattr(Problem, "gauss_newton", noted)
    what_is_left_out(problem, PLAN, [rung], 0)
    assert begun == [rung.solution.terms]


def test_beliefs_are_averaged_by_evidence_unless_nothing_is_likelier():
    def added(*evidence):
        beliefs = [
            SimpleNamespace(evidence=one, adds=lambda follow, k=k: 10.0**k * follow @ follow.T)
            for k, one in enumerate(evidence)
        ]
        return discrepancy._averaged(beliefs, np.ones((1, 1)))[0, 0]

    assert added(-1.0, 0.0) == 0.0
    assert added(np.log(4), 0.0) == pytest.approx(0.8 * 1 + 0.2 * 10)
    assert added(30.0, 0.0) == pytest.approx(1.0)


def test_one_function_among_many_is_believed_alone(rng):
    """All alike, the others would have to be as large, which data deny."""
    count = 8
    data = Information(1e4 * np.eye(9 * count), np.zeros(9 * count), 1.0)
    data.slope[27:36] = 3e4 * rng.normal(size=9)
    beliefs = discrepancy._beliefs(data, count)
    best = max(beliefs, key=lambda one: one.evidence)
    assert np.flatnonzero(best.size).tolist() == [3]
    assert sum(len(np.flatnonzero(one.size)) == count for one in beliefs) == 2  # two lengths
    alone = [one.evidence for one in beliefs if np.flatnonzero(one.size).tolist() == [3]]
    assert len(alone) == 3  # entered first and last, and by itself with each length
