"""Every recording has a sensor offset of its own; the lag behind them is shared."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, Fit, InputError, Model, Predictor, identify, ladder_plan, physical
from penode.arrays import Leaf, float64
from penode.data.windows import cut
from penode.models.layout import Layout
from penode.models.parameters import Normal, nuisance
from penode.models.transforms import Positive
from penode.training.loss import Loss
from penode.training.penalties import Priors
from penode.training.residuals import Objective

STEP, LENGTHS, OFFSETS = 0.1, (260, 150, 200), (0.5, -0.3, 0.1)


class Lag(Model):
    """x' = b u - a x, read by a sensor with an offset of its own in each recording."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("K",)

    a: Leaf = physical("1/s", Positive())
    offset: Leaf = nuisance("K", prior=Normal(0.0, 1.0))
    b: Leaf = physical("K/s")

    def derivative(self, x, u):
        return self.b * u.values - self.a * x

    def corrected(self, measured):
        return measured - self.offset


def recorded(noise):
    """Record a lag of 1 s, a = 1 and b = 2, the input held."""
    random, runs, decay = np.random.default_rng(9), [], np.exp(-STEP)
    for k, (length, offset) in enumerate(zip(LENGTHS, OFFSETS, strict=True)):
        time, x = STEP * np.arange(length), np.zeros(length)
        u = np.sin(0.9 * time + k) + np.sign(np.sin(0.31 * time + k))
        for n in range(length - 1):
            x[n + 1] = decay * x[n] + 2 * (1 - decay) * u[n]
        read = x + offset + noise * random.normal(size=length)
        runs.append(Experiment(f"run{k}.csv", STEP, {"x": read, "u": u}))
    return runs


@pytest.fixture(scope="module")
def fit():
    start = Lag(a=0.5, offset=0.0, b=1.0)
    seen, unseen = recorded(1e-3), recorded(1e-3)[:1]
    return identify(start, seen, plan=ladder_plan((2, 7)), validation=unseen)


def test_offsets_and_shared_parameters_are_found(fit):
    np.testing.assert_allclose(fit.nuisances["offset"], OFFSETS, rtol=0, atol=2e-3)
    for name, truth in (("a", 1.0), ("b", 2.0)):
        assert fit.parameters[name].value == pytest.approx(truth, rel=5e-3)
    assert set(fit.parameters) == {"a", "b"}


def test_the_model_of_a_fit_has_the_mean(fit):
    assert float(fit.model.offset) == pytest.approx(np.mean(fit.nuisances["offset"]))


def test_a_training_recording_is_predicted_with_its_own_offset(fit):
    *seen, unseen = fit.comparisons
    for run, comparison, offset in zip(recorded(1e-3), seen, fit.nuisances["offset"], strict=True):
        np.testing.assert_allclose(comparison.measured[:, 0], run.channels["x"] - offset)
        assert comparison.one_step_rmse < 3e-3
        assert comparison.free_run_rmse < 3e-3
    assert unseen.free_run_rmse > 0.1
    assert fit.horizon.ladder[-1].free_run_rmse < 3e-3


def test_nuisances_are_saved_and_loaded(fit, tmp_path):
    fit.save(tmp_path)
    loaded = Fit.load(tmp_path)
    assert set(loaded.nuisances) == {"offset"}
    np.testing.assert_array_equal(loaded.nuisances["offset"], fit.nuisances["offset"])


def test_training_needs_the_group_of_nuisances():
    layout = Layout(Lag(1.0, 0.0, 1.0), 3)
    np.testing.assert_array_equal(layout.members(("nuisance",)), [0, 1, 1, 1, 0])
    np.testing.assert_array_equal(layout.members(("physical",)), [1, 0, 0, 0, 1])
    with pytest.raises(InputError, match="got offset"):
        layout.members(("offset",))


# --- the layout -------------------------------------------------------------------------------


class Sensors(Model):
    """A nuisance that is a vector and constrained, between others."""

    states: ClassVar[tuple[str, ...]] = ("x", "y")
    inputs: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ("m", "m")

    first: Leaf = physical("m")
    gain: Leaf = nuisance("1", Positive(), Normal(1.0, 0.5))
    last: Leaf = physical("m")

    def derivative(self, x, u):
        return -x


GAINS = np.array([[1.0, 2.0], [3.0, 5.0], [0.5, 0.25]])


@pytest.fixture(scope="module")
def layout():
    return Layout(Sensors(7.0, np.array([1.0, 1.0]), 9.0), 3)


@pytest.fixture(scope="module")
def raw():
    return np.array([7.0, *np.log(GAINS).ravel(), 9.0])


def test_a_model_is_copied_to_every_recording(layout):
    start = layout.raw(Sensors(7.0, np.array([2.0, 4.0]), 9.0))
    assert layout.size == len(start) == 8
    np.testing.assert_allclose(start, [7.0, *np.log([2.0, 4.0] * 3), 9.0], rtol=1e-15)


def test_each_recording_has_its_own_and_the_model_their_mean(layout, raw):
    with float64():
        values = np.asarray(layout.values(jnp.asarray(raw)))
        own = [layout.plain_model(raw, k) for k in range(3)]
        mean, found = layout.plain_model(raw), layout.nuisances(raw)
    np.testing.assert_allclose(values, [7.0, *GAINS.ravel(), 9.0], rtol=1e-14)
    np.testing.assert_allclose([m.gain for m in own], GAINS, rtol=1e-14)
    np.testing.assert_allclose(mean.gain, GAINS.mean(axis=0), rtol=1e-14)
    assert all((float(m.first), float(m.last)) == (7.0, 9.0) for m in (mean, *own))
    assert set(found) == {"gain"}
    np.testing.assert_allclose(found["gain"], GAINS, rtol=1e-14)


def test_a_batch_has_shares_of_the_recordings(layout, raw):
    shares = np.array([[0.0, 1.0, 0.5, 0.0], [1.0, 0.0, 0.5, 0.0], [0.0, 0.0, 0.0, 1.0]])
    with float64():
        values = layout.values(jnp.asarray(raw))[:, None] * np.array([1.0, 1.0, 1.0, 2.0])
        model = layout.model(values, jnp.asarray(shares))
    expected = [GAINS[1], GAINS[0], (GAINS[0] + GAINS[1]) / 2, 2 * GAINS[2]]
    np.testing.assert_allclose(model.gain, np.transpose(expected), rtol=1e-14)
    np.testing.assert_array_equal(model.last, [9.0, 9.0, 9.0, 18.0])


def test_every_copy_has_the_prior(layout, raw):
    with float64():
        found = layout.beliefs(layout.values(jnp.asarray(raw)))
    np.testing.assert_allclose(found, (GAINS.ravel() - 1.0) / 0.5, rtol=1e-13)


def test_one_recording_has_one_copy(raw):
    layout = Layout(Sensors(7.0, GAINS[0], 9.0))
    assert layout.size == 4
    with float64():
        found = layout.nuisances(layout.raw(Sensors(7.0, GAINS[0], 9.0)))
    np.testing.assert_allclose(found["gain"], GAINS[:1], rtol=1e-14)


# --- the objective ----------------------------------------------------------------------------


def explicit(raw, windows, horizon):
    """Return residuals (step, window), by the fourth-order series of the exponential."""
    a, offsets, b = np.exp(raw[0]), raw[1:4, None], raw[4]
    own = np.take_along_axis(offsets + 0 * windows.recording, windows.recording[None], axis=0)[0]
    z = -a * STEP
    decay = 1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))
    x, rows = windows.states[windows.starts, 0] - own, []
    for k in range(horizon):
        x = decay * x + (decay - 1) / -a * b * windows.inputs[windows.starts + k, 0]
        rows.append(windows.states[windows.starts + k + 1, 0] - own - x)
    return np.array(rows)


def test_gradient_and_terms_are_those_of_the_explicit_residual():
    """Each window has the offset of its recording, at its start and in what it is compared with."""
    horizon, raw = 4, np.array([0.2, 0.4, -0.2, 0.3, 1.5])
    windows = cut(recorded(0.05), ("x",), ("u",), horizon)
    loss = Loss(penalties=(Priors(0.3, 10),))
    objective = Objective(Predictor(STEP), Lag(1.0, 0.0, 1.0), np.ones(1), loss, experiments=3)
    residual = explicit(raw, windows, horizon).ravel()
    steps = 1e-30j * np.eye(5)
    jacobian = np.stack([explicit(raw + s, windows, horizon).imag.ravel() / 1e-30 for s in steps]).T
    prior, slope = 0.3 / np.sqrt(10) * raw[1:4], 0.3 / np.sqrt(10) * np.eye(5)[1:4]
    count = residual.size
    terms = objective.gauss_newton(raw, windows)
    assert terms.loss == pytest.approx(np.mean(residual**2) + prior @ prior, rel=1e-12)
    normal = jacobian.T @ jacobian + count * slope.T @ slope
    np.testing.assert_allclose(terms.normal, normal, rtol=0, atol=1e-11 * np.abs(normal).max())
    descent = -jacobian.T @ residual - count * slope.T @ prior
    np.testing.assert_allclose(terms.descent, descent, rtol=0, atol=1e-11 * np.abs(descent).max())
    value, gradient = objective.loss_and_gradient(raw, windows)
    assert value == pytest.approx(terms.loss, rel=1e-12)
    np.testing.assert_allclose(gradient, -2 * descent / count, rtol=1e-10, atol=1e-13)
