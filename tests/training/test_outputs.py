"""Outputs y = h(x, u, theta): the identity is no change, and h is that of a twin in NumPy.

The twin takes the same Runge-Kutta steps and is differentiated by complex steps.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from penode import Experiment, InputError, Model, Predictor, identify, ladder_plan, physical
from penode.arrays import Leaf, float64
from penode.data.windows import Windows
from penode.engine import AdamsBashforth, Loss, Prefilter, Substeps, equation, last_step
from penode.native.normal_matrix import NormalMatrix
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.tableaus import AB2
from penode.training import free_starts
from penode.training.chunks import _sum_over_chunks
from penode.training.prediction_error import compiled_windows
from penode.training.residuals import Objective
from penode.training.sensitivities import window_sums
from penode.training.window_states import start_states

STEP, HORIZON, WINDOWS = 0.1, 6, 30


class Oscillator(Model):
    """x'' = u - k (x + x^3) - c x', both states measured."""

    states: ClassVar = ("x", "v")
    inputs: ClassVar = ("u",)
    state_units: ClassVar = ("m", "m/s")

    k: Leaf = physical("1/s2")
    c: Leaf = physical("1/s")

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0] - self.k * (x[0] + x[0] ** 3) - self.c * x[1]])


class Identity(Oscillator):
    """The same, its states as outputs of their names."""

    outputs: ClassVar = {"x": "m", "v": "m/s"}

    def output(self, x, u):
        return x


class Renamed(Identity):
    """The same, the outputs with names of their own; channels of the states are first guesses."""

    outputs: ClassVar = {"position": "m", "speed": "m/s"}


class Hidden(Oscillator):
    """The speed is not measured."""

    unmeasured: ClassVar = ("v",)


class Position(Oscillator):
    """The same as an output."""

    outputs: ClassVar = {"x": "m"}

    def output(self, x, u):
        return x[:1]


RAW, SCALE = np.array([1.7, 0.3]), np.array([0.5, 1.2])


def slope(raw, x, u):
    return np.stack([x[1] + 0 * raw[0], u - raw[0] * (x[0] + x[0] ** 3) - raw[1] * x[1]])


def stepped(raw, x, u, count):
    h = STEP / count
    for _ in range(count):
        k1 = slope(raw, x, u)
        k2 = slope(raw, x + h / 2 * k1, u)
        k3 = slope(raw, x + h / 2 * k2, u)
        k4 = slope(raw, x + h * k3, u)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def recorded(samples=400, noise=3e-3):
    """Record both states of an oscillator, integrated four times as finely."""
    random, state, path = np.random.default_rng(4), np.array([0.5, -1.0]), []
    u = np.repeat(random.uniform(-2.0, 2.0, samples // 8), 8)
    for push in u:
        path.append(state)
        state = stepped(RAW, state, push, 4)
    x, v = np.array(path).T + noise * random.normal(size=(2, samples))
    return Experiment("run", STEP, {"x": x, "v": v, "position": x, "speed": v, "u": u})


RUN = recorded()


def windows_of(model, horizon=HORIZON):
    states, inputs = RUN.stack(("x", "v")), RUN.stack(("u",))
    outputs = RUN.stack(tuple(model.outputs)) if model.outputs else None
    starts = np.arange(0, 150, 5)
    return Windows(states, inputs, starts, 0 * starts, horizon, 1, STEP, outputs)


@pytest.fixture
def exact(monkeypatch):
    """Start over wherever one step is not enough to rounding."""
    monkeypatch.setattr(free_starts, "_ACCEPTED", 0.0)
    _sum_over_chunks.clear_cache()
    yield
    monkeypatch.undo()
    _sum_over_chunks.clear_cache()


LOSSES = {"every step": {}, "the last step": {"weight": last_step}}
FREE = {"x": None, "v": None}
#: What `make test` checks of all pairs.
QUICK = {(Renamed, "every step")}


@pytest.mark.parametrize(
    ("like", "loss"),
    [
        pytest.param(like, loss, marks=() if (like, loss) in QUICK else pytest.mark.slow)
        for like in (Identity, Renamed)
        for loss in LOSSES
    ],
)
@pytest.mark.usefixtures("exact", "quickly_compiled")
def test_an_output_that_is_the_identity_changes_no_term(like, loss):
    """Of windows whose measured first sample counts as any other."""
    plain, same = (
        Objective(Predictor(STEP), model, SCALE, Loss(free_starts=free, **LOSSES[loss]))
        for model, free in ((Oscillator(*RAW), FREE), (like(*RAW), {}))
    )
    given = windows_of(Oscillator(*RAW)), windows_of(like(*RAW))
    one, other = plain.gauss_newton(RAW, given[0]), same.gauss_newton(RAW, given[1])
    assert other.count == one.count
    assert other.loss == pytest.approx(one.loss, rel=1e-10)
    size = np.abs(one.normal).max()
    np.testing.assert_allclose(other.normal, one.normal, rtol=0, atol=1e-10 * size)
    size = np.abs(one.scores).max()
    np.testing.assert_allclose(other.scores, one.scores, rtol=0, atol=1e-10 * size)
    first, second = plain.loss_and_gradient(RAW, given[0]), same.loss_and_gradient(RAW, given[1])
    assert second[0] == pytest.approx(first[0], rel=1e-10)
    np.testing.assert_allclose(second[1], first[1], rtol=1e-9)
    first, second = plain.sample_scores(RAW, given[0]), same.sample_scores(RAW, given[1])
    np.testing.assert_allclose(second, first, rtol=0, atol=1e-10 * np.abs(first).max())
    first = start_states(plain.error, RAW, given[0])
    second = start_states(same.error, RAW, given[1])
    np.testing.assert_allclose(second, first, rtol=0, atol=1e-9)


@pytest.mark.slow  # the terms of which it is made are compared above
@pytest.mark.parametrize(
    ("plain", "same"),
    [pytest.param(Oscillator, Identity, marks=pytest.mark.slow), (Hidden, Position)],
)
def test_an_output_that_is_the_identity_changes_no_estimate(plain, same):
    """By default, from the first horizon on."""
    one, other = (identify(kind(1.2, 0.1), [RUN]) for kind in (plain, same))
    assert one.horizon.selected == other.horizon.selected
    assert [h.horizon for h in one.horizon.ladder] == [h.horizon for h in other.horizon.ladder]
    for name, found in one.parameters.items():
        assert other.parameters[name].value == pytest.approx(found.value, rel=1e-10)
        assert other.parameters[name].std == pytest.approx(found.std, rel=1e-8)
        assert found.interval_95[0] < {"k": 1.7, "c": 0.3}[name] < found.interval_95[1]


# --- a nonlinear output ---------------------------------------------------------------------------


class Seen(Oscillator):
    """Neither state is measured, but a strain with feedthrough, and the power in the damper."""

    outputs: ClassVar = {"strain": "1", "power": "W"}

    gain: Leaf = physical("1/m")
    offset: Leaf = physical("1")

    def output(self, x, u):
        strain = self.gain * jnp.sin(x[0]) + self.offset + 0.1 * u["u"]
        return jnp.stack([strain, self.c * x[1] ** 2])


SEEN = np.array([1.5, 0.35, 0.8, 0.1])


def read(raw, x, u):
    return np.stack([raw[2] * np.sin(x[0]) + raw[3] + 0.1 * u, raw[1] * x[1] ** 2])


class Twin:
    """The joint residual of windows, by parameters and starts."""

    def __init__(self, count):
        random = np.random.default_rng(2)
        u = RUN.channels["u"]
        clean = read(np.array([1.7, 0.3, 0.9, 0.05]), RUN.stack(("x", "v")).T, u)
        self.outputs = clean.T + 0.01 * random.normal(size=(len(u), 2))
        guess = RUN.stack(("x", "v")) + 0.02 * random.normal(size=(len(u), 2))
        starts, self.count = np.arange(0, 5 * WINDOWS, 5), count
        self.windows = Windows(
            guess, u[:, None], starts, 0 * starts, HORIZON, 1, STEP, self.outputs
        )

    def residual(self, raw, correction):
        """Return scaled errors, (residual, window), of raw (4, window or 1) and (2, window)."""
        at, rows = self.windows.starts, []
        x = self.windows.states[at].T + correction
        for k in range(HORIZON + 1):
            u = self.windows.inputs[at + k, 0]
            rows.append((self.outputs[at + k].T - read(raw, x, u)) / SCALE[:, None])
            x = stepped(raw, x, u, self.count)
        return np.concatenate(rows)

    def jacobian(self, raw, correction):
        """Return J, (residual, window, column), the columns being raw and correction."""
        both = np.concatenate([np.broadcast_to(raw, (4, WINDOWS)), correction])
        columns = []
        for k in range(len(both)):
            moved = both + 1e-30j * np.eye(len(both))[:, [k]]
            columns.append(self.residual(moved[:4], moved[4:]).imag / 1e-30)
        return np.stack(columns, axis=-1)

    def starts(self, raw):
        """Return each window's best correction by SciPy."""
        zero, found = np.zeros((2, WINDOWS)), []
        for w in range(WINDOWS):

            def at(own, w=w):
                moved = zero.copy()
                moved[:, w] = own
                return moved

            solution = least_squares(
                lambda own, w=w: self.residual(raw, at(own))[:, w],
                np.zeros(2),
                jac=lambda own, w=w: self.jacobian(raw, at(own))[:, w, 4:],
                method="lm",
                xtol=1e-15,
                ftol=1e-15,
                gtol=1e-15,
            )
            found.append(solution.x)
        return np.array(found).T


@pytest.fixture(scope="module")
def case():
    """Return the twin and the objective, two steps a sample that read a table of inputs."""
    solver = Substeps(DEFAULT_SOLVER, 2)
    return Twin(2), Objective(Predictor(STEP, solver), Seen(*SEEN), SCALE)


def one_step():
    """Return the twin and the objective, one step a sample that reads the inputs themselves."""
    return Twin(1), Objective(Predictor(STEP, DEFAULT_SOLVER), Seen(*SEEN), SCALE)


@pytest.mark.usefixtures("quickly_compiled")
@pytest.mark.parametrize("tabulated", [True, False])
def test_joint_sums_are_those_of_the_twin(case, tabulated):
    """At corrections that are no minimum, the parameters and the starts being columns alike."""
    twin, objective = case if tabulated else one_step()
    correction = 0.05 * np.random.default_rng(1).normal(size=(2, WINDOWS))
    error = objective.error
    with float64():
        windows = error.predictor.prepared(twin.windows.inputs)
        given = Windows(
            twin.windows.states, windows, twin.windows.starts, twin.windows.recording,
            HORIZON, 1, STEP, twin.outputs,
        )  # fmt: skip
        batch = compiled_windows(error, given, WINDOWS)
        values = jnp.broadcast_to(jnp.asarray(SEEN)[:, None], (4, WINDOWS))
        normal = NormalMatrix.zero(4, values)
        sums = window_sums(
            error, values, jnp.asarray(correction), jnp.asarray(HORIZON), batch, normal
        )
        squares, scores, mixed = sums.squares, sums.scores, sums.mixed
        whole = np.asarray(sums.normal.whole)
    residual = twin.residual(SEEN[:, None], correction)
    jacobian = -twin.jacobian(SEEN[:, None], correction)
    joint = np.einsum("rwi,rwj->ijw", jacobian, jacobian)
    expected = np.einsum("rwi,rw->iw", jacobian, residual)
    np.testing.assert_allclose(squares, np.sum(residual**2, axis=0), rtol=1e-10)
    for found, wanted in (
        (scores.shared, expected[:4]),
        (scores.own, expected[4:]),
        (mixed.shared, joint[4:, :4]),
        (mixed.own, joint[4:, 4:]),
        (whole, joint[:4, :4].sum(axis=-1)),
    ):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.usefixtures("exact", "quickly_compiled")
def test_terms_are_the_schur_complement_and_the_gradient_that_of_the_loss(case):
    twin, objective = case
    inputs = objective.predictor.prepared(twin.windows.inputs)
    windows = Windows(
        twin.windows.states, inputs, twin.windows.starts, twin.windows.recording,
        HORIZON, 1, STEP, twin.outputs,
    )  # fmt: skip
    correction = twin.starts(SEEN[:, None])
    residual = twin.residual(SEEN[:, None], correction)
    jacobian = -twin.jacobian(SEEN[:, None], correction)
    normal, descent = np.zeros((4, 4)), np.zeros(4)
    for w in range(WINDOWS):
        shared, own = jacobian[:, w, :4], jacobian[:, w, 4:]
        joint, mixed = own.T @ own, own.T @ shared
        normal += shared.T @ shared - mixed.T @ np.linalg.solve(joint, mixed)
        descent += (shared.T - mixed.T @ np.linalg.solve(joint, own.T)) @ residual[:, w]
    terms = objective.gauss_newton(SEEN, windows)
    assert terms.count == WINDOWS * HORIZON * 2
    assert terms.loss == pytest.approx(np.sum(residual**2) / terms.count, rel=1e-8)
    np.testing.assert_allclose(terms.normal, normal, rtol=0, atol=1e-8 * np.abs(normal).max())
    np.testing.assert_allclose(terms.descent, descent, rtol=0, atol=1e-8 * np.abs(descent).max())
    loss, gradient = objective.loss_and_gradient(SEEN, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-10)
    np.testing.assert_allclose(gradient, -2 * descent / terms.count, rtol=1e-7)
    samples = objective.sample_scores(SEEN, windows)
    np.testing.assert_allclose(samples.sum(axis=1), descent, rtol=1e-7)
    first = start_states(objective.error, SEEN, windows).T - windows.states[windows.starts].T
    np.testing.assert_allclose(first, correction, rtol=0, atol=1e-7)


@pytest.mark.slow
def test_a_prefilter_begins_behind_the_first_sample(case):
    """The start is one more measured sample, unfiltered."""
    twin, objective = case
    inputs = objective.predictor.prepared(twin.windows.inputs)
    windows = Windows(
        twin.windows.states, inputs, twin.windows.starts, twin.windows.recording,
        HORIZON, 1, STEP, twin.outputs,
    )  # fmt: skip
    filtered = Objective(
        objective.predictor, Seen(*SEEN), SCALE, Loss(prefilter=Prefilter((1.0, -0.5)))
    )
    loss, gradient = filtered.loss_and_gradient(SEEN, windows)
    terms = filtered.gauss_newton(SEEN, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-6)
    np.testing.assert_allclose(gradient, -2 * terms.descent / terms.count, rtol=1e-3)


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("loss", "solver", "words"),
    [
        (Loss(equation), DEFAULT_SOLVER, "x, v is not measured, but errors in the equation's"),
        (Loss(), AdamsBashforth(AB2), "starts of x, v are to be estimated"),
        (Loss(free_starts={"x": 1.0}), DEFAULT_SOLVER, "free_starts must be empty for Seen"),
    ],
)
def test_what_needs_measured_states_is_refused(loss, solver, words):
    with pytest.raises(InputError, match=words) as caught:
        Objective(Predictor(STEP, solver), Seen(*SEEN), SCALE, loss)
    assert str(caught.value).endswith(".")


def test_a_horizon_that_shows_only_its_own_start_has_no_interval():
    """Two outputs at two samples are as many as two states and two parameters' worth."""
    run = Experiment("run", STEP, {"x": RUN.channels["x"], "u": RUN.channels["u"]})
    fit = identify(Position(1.7, 0.3), [run], plan=ladder_plan((1,)))
    assert fit.parameters["k"].std == np.inf
    assert any("spend all they show on their own start" in one for one in fit.warnings)
