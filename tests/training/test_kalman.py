"""A filter around a model, against a Kalman filter written out with NumPy."""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from penode import Experiment, Fit, InputError, Model, Predictor, identify, ladder_plan, physical
from penode.arrays import Leaf
from penode.data.windows import Jittered, cut
from penode.engine import ExtendedKalman, compare
from penode.models.explicit_time import driving_channels
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import AB2, RK4
from penode.training.loss import Loss
from penode.training.residuals import Objective
from penode.validation.free_run import with_unmeasured

pytestmark = pytest.mark.usefixtures("quickly_compiled")

STEP, COUNT, HORIZON = 0.05, 400, 60
FINE = Predictor(STEP, Substeps(RungeKutta(RK4), 8))


class Spring(Model):
    """Two states, of which the position and a mix of both are read."""

    states: ClassVar = ("place", "rate")
    state_units: ClassVar = ("m", "m/s")
    inputs: ClassVar = ("force",)
    outputs: ClassVar = {"position": "m", "mix": "m"}

    stiffness: Leaf = physical("1/s2")
    damping: Leaf = physical("1/s")

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0] - self.stiffness * x[0] - self.damping * x[1]])

    def output(self, x, u):
        return jnp.stack([x[0], 0.3 * x[0] + 0.2 * x[1]])


class Measured(Model):
    """The same with both states measured as they are."""

    states: ClassVar = ("place", "rate")
    state_units: ClassVar = ("m", "m/s")
    inputs: ClassVar = ("force",)

    stiffness: Leaf = physical("1/s2")
    damping: Leaf = physical("1/s")

    derivative = Spring.derivative


READ = np.array([[1.0, 0.0], [0.3, 0.2]])
NOISE = {"process": (0.05, 0.3), "sensor": (0.02, 0.03)}
SLOW = {"correlated": (0.04, 0.01), "time_constant": 0.4}


def system(stiffness, damping, process, sensor, correlated=None, time_constant=None):
    """Return matrices of one sample: F, G, C, Q and R."""
    a, b = np.array([[0, 1], [-stiffness, -damping]]), np.array([0.0, 1.0])
    read, density = READ, np.array(process) ** 2
    if correlated is not None:
        a = np.block([[a, np.zeros((2, 2))], [np.zeros((2, 2)), -np.eye(2) / time_constant]])
        b, read = np.r_[b, 0, 0], np.hstack([read, np.eye(2)])
        density = np.r_[density, 2 * np.array(correlated) ** 2 / time_constant]
    n = len(a)
    driven = expm(STEP * np.block([[a, b[:, None]], [np.zeros((1, n + 1))]]))
    loan = expm(STEP * np.block([[-a, np.diag(density)], [np.zeros((n, n)), a.T]]))
    forward = loan[n:, n:].T
    noise = forward @ loan[:n, n:]
    return driven[:n, :n], driven[:n, n], read, noise, np.diag(np.array(sensor) ** 2)


def kalman(matrices, start, measured, force):
    """Return predicted outputs (time, output), one sample ahead but for the first."""
    forward, driven, read, noise, white = matrices
    x, covariance, predicted = np.array(start, dtype=float), np.zeros(forward.shape), []
    for y, u in zip(measured, force, strict=True):
        predicted.append(read @ x)
        gain = covariance @ read.T @ np.linalg.inv(read @ covariance @ read.T + white)
        x = x + gain @ (y - predicted[-1])
        covariance = covariance - gain @ read @ covariance
        x, covariance = forward @ x + driven * u, forward @ covariance @ forward.T + noise
    return np.array(predicted)


@pytest.fixture(scope="module")
def run():
    random, (forward, driven, read, noise, white) = (
        np.random.default_rng(5),
        system(4, 0.5, **NOISE),
    )
    root, x, read_out = np.linalg.cholesky(noise), np.array([0.3, -0.2]), []
    force = 2 * random.normal(size=COUNT // 10).repeat(10)
    for u in force:
        read_out.append(read @ x + np.sqrt(np.diag(white)) * random.normal(size=2))
        x = forward @ x + driven * u + root @ random.normal(size=2)
    position, mix = np.transpose(read_out)
    rate = (mix - 0.3 * position) / 0.2
    channels = {"position": position, "mix": mix, "force": force}
    return Experiment("run", STEP, {**channels, "place": position, "rate": rate})


def windows_of(model, run, horizon=HORIZON, predictor=FINE):
    return cut(
        [with_unmeasured(run, model)],
        model.states,
        driving_channels(model),
        horizon,
        output_names=tuple(model.outputs),
        placement=Jittered(1),
        prepared=predictor.prepared,
    )


@pytest.mark.parametrize("slow", [{}, SLOW], ids=["white", "correlated too"])
def test_predictions_are_those_of_a_kalman_filter(run, slow):
    model = ExtendedKalman(Spring(3.5, 0.6), **NOISE, **slow)
    seen = compare(FINE, model, run)
    count = 4 if slow else 2
    measured, force = run.stack(("position", "mix")), run.channels["force"]
    expected = kalman(system(3.5, 0.6, **NOISE, **slow), seen.start[:count], measured, force)
    np.testing.assert_allclose(seen.one_step, expected, rtol=0, atol=1e-8)
    alone = compare(FINE, Spring(3.5, 0.6), run)
    free = alone.free_run if not slow else seen.free_run
    np.testing.assert_allclose(seen.free_run, free, rtol=0, atol=1e-9)


def test_loss_and_gradient_are_those_of_a_kalman_filter(run):
    """The loss at each window's best start, which the filter's errors depend on linearly."""
    model = ExtendedKalman(Spring(3.5, 0.6), **NOISE)
    scale = np.array([0.1, 0.05])
    objective = Objective(FINE, model, scale, Loss())
    windows, raw = windows_of(model, run), objective.layout.raw(model)

    def loss(raw):
        stiffness, damping, *noise = raw
        first, second, ratio = np.exp(noise)
        matrices = system(stiffness, damping, (first, second), (0.02, 0.02 * ratio))
        squares = 0.0
        for start in windows.starts:
            at = slice(start, start + HORIZON + 1)
            given = run.stack(("position", "mix"))[at], run.channels["force"][at]
            error = ((given[0] - kalman(matrices, (0, 0), *given)) / scale).ravel()
            slopes = [
                (kalman(matrices, unit, *given) - kalman(matrices, (0, 0), *given)) / scale
                for unit in np.eye(2)
            ]
            slopes = np.stack([slope.ravel() for slope in slopes], axis=1)
            left = error - slopes @ np.linalg.lstsq(slopes, error, rcond=None)[0]
            squares += left @ left
        return squares / (len(windows.starts) * HORIZON * 2)

    terms = objective.gauss_newton(raw, windows)
    assert terms.loss == pytest.approx(loss(raw), rel=1e-8)
    step, count = 1e-3, terms.count
    gradient = [
        sum(
            weight * loss(raw + k * step * unit)
            for k, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
        )
        / step
        for unit in np.eye(len(raw))
    ]
    size = np.abs(gradient).max()
    np.testing.assert_allclose(-2 * terms.descent / count, gradient, rtol=0, atol=1e-8 * size)
    reverse = objective.loss_and_gradient(raw, windows)[1]
    np.testing.assert_allclose(reverse, gradient, rtol=0, atol=1e-8 * size)


def test_without_process_noise_it_is_the_model_itself(run):
    """NOE is one end."""
    plain = Spring(3.5, 0.6)
    model = ExtendedKalman(plain, (1e-12, 0.0), (1.0, 1.0))
    alone, filtered = (
        Objective(FINE, one, np.ones(2), Loss()).gauss_newton(raw, windows_of(one, run)).loss
        for one, raw in ((plain, np.array([3.5, 0.6])), (model, _raw(model)))
    )
    assert filtered == pytest.approx(alone, rel=1e-9)


def test_with_much_of_it_every_step_begins_at_the_sample_before(run):
    """NARX is the other: a window of many steps errs as much as all its single steps."""
    plain = Measured(3.5, 0.6)
    model = ExtendedKalman(plain, (1e3, 1e3), (1e-3, 1e-3))
    long = windows_of(model, run)
    one = windows_of(plain, run, 1)
    starts = np.concatenate([at + np.arange(HORIZON) for at in long.starts])
    single = replace(one, starts=starts, recording=0 * starts)
    every = Objective(FINE, plain, np.ones(2), Loss()).gauss_newton(np.array([3.5, 0.6]), single)
    filtered = Objective(FINE, model, np.ones(5), Loss()).gauss_newton(_raw(model), long)
    assert filtered.loss == pytest.approx(every.loss, rel=1e-6)


@pytest.mark.slow  # the how-to on recordings as they are makes such a fit
def test_a_fit_keeps_its_filter(run, tmp_path):
    model = ExtendedKalman(Spring(3.5, 0.6), **NOISE)
    fit = identify(model, [run], plan=ladder_plan((40,)))
    assert np.isfinite(list(fit.comparisons[0].one_step_errors.values())).all()
    assert set(fit.initial_states["run"]) == {"place", "rate"}
    fit.save(tmp_path / "result")
    again = Fit.load(tmp_path / "result", trust=True)
    np.testing.assert_array_equal(again.model.process, fit.model.process)
    np.testing.assert_array_equal(again.compare(run).one_step, fit.comparisons[0].one_step)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"process": (0.1,), "sensor": (1.0, 1.0)}, "process must have one number for each"),
        ({"process": (0.1, -1.0), "sensor": (1.0, 1.0)}, "process must be >= 0"),
        ({"process": (0.1, 0.0), "sensor": (1.0, 0.0)}, "sensor must be > 0"),
        ({**NOISE, "time_constant": 1.0}, "must be given together"),
        ({**NOISE, **SLOW, "time_constant": 0.0}, "time_constant must be > 0"),
    ],
)
def test_what_is_no_noise_is_refused(given, words):
    with pytest.raises(InputError, match=words):
        ExtendedKalman(Spring(1.0, 1.0), **given)


def test_correlated_noise_of_states_is_refused():
    with pytest.raises(InputError, match="whose states are measured as they are"):
        ExtendedKalman(Measured(1.0, 1.0), **NOISE, **SLOW)


def test_a_multistep_solver_is_refused(run):
    plan = replace(ladder_plan((40,)), solver=AdamsBashforth(AB2))
    with pytest.raises(InputError, match=r"states are to be filtered, but .* one-step solver"):
        identify(ExtendedKalman(Measured(3.5, 0.6), **NOISE), [run], plan=plan)


def _raw(model):
    return np.concatenate([[3.5, 0.6], np.log(model.process), np.log(model.ratio)])
