"""The deviation of a free run is what drawn parameters scatter it by, for every kind of model."""

from typing import ClassVar

import numpy as np
import pytest
from tests.test_measured_outputs import STEP, TRUTH, Pendulum, recorded

from penode import Experiment, Fit, Model, Predictor
from penode.arrays import float64
from penode.errors import InputError
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.models.layout import Layout
from penode.models.polynomials import Polynomial
from penode.validation.free_run import compare
from penode.validation.free_run_deviation import free_run_deviation

DRAWS = 150


class Cubic(Model):
    """x' = -f(x), f learned; no parameter is physical."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    outflow: Polynomial

    def derivative(self, x, u):
        return -self.outflow.value_and_jacobian(x)[0]


def drawn(predictor, model, experiment, covariance, seed=3):
    """Return free runs (draw, time, quantity) of parameters drawn from the covariance."""
    layout, random = Layout(model), np.random.default_rng(seed)
    raws = random.multivariate_normal(layout.raw(model), covariance, DRAWS, method="eigh")
    with float64():
        models = [layout.plain_model(raw) for raw in raws]
    return np.stack([compare(predictor, one, experiment).free_run for one in models])


def matches(deviation, runs, tolerance=0.15):
    """Require the deviations (time, quantity) to be those of runs, over time and at their ends."""
    scatter = runs.std(axis=0, ddof=1)
    for found, wanted in ((deviation, scatter), (deviation[-40:], scatter[-40:])):
        ratio = np.sqrt(np.mean(found**2, axis=0) / np.mean(wanted**2, axis=0))
        np.testing.assert_allclose(ratio, 1.0, atol=tolerance)


def covariance_of(model, size=1e-3, seed=7):
    """Return a covariance of raw parameters, all correlated, of a size small to each."""
    raw = Layout(model).raw(model)
    root = np.random.default_rng(seed).normal(size=(len(raw), len(raw))) / np.sqrt(len(raw))
    root *= size * np.maximum(np.abs(raw), 0.1 * np.abs(raw).max())[:, None]
    return root @ root.T


@pytest.mark.parametrize(
    "name",
    [
        "duffing",
        "coenergy machine",
        pytest.param("linear machine", marks=pytest.mark.slow),
        pytest.param("mlp machine", marks=pytest.mark.slow),
    ],
)
def test_it_is_the_scatter_of_drawn_parameters(name, systems):
    system = systems[name]
    predictor, run = Predictor(system.time_step), system.experiments[1]
    covariance = covariance_of(system.model)
    found = free_run_deviation(predictor, system.model, run, covariance)
    assert found.shape == (len(run), len(system.model.states))
    np.testing.assert_array_equal(found[0], 0.0)
    matches(found, drawn(predictor, system.model, run, covariance))


@pytest.fixture(scope="module")
def pendulum():
    """Return the true pendulum, its predictor, and a recording without noise."""
    model, predictor = Pendulum(**TRUTH), Predictor(STEP)
    run = recorded(4, samples=300)[0]
    said = compare(predictor, model, run)
    silent = dict(zip(said.states, said.free_run.T, strict=True))
    return model, predictor, Experiment("run", STEP, {**run.channels, **silent})


def test_an_estimated_start_follows_the_parameters(pendulum):
    model, predictor, run = pendulum
    covariance = covariance_of(model)
    found = free_run_deviation(predictor, model, run, covariance)
    assert (found[0] > 0).all()
    matches(found, drawn(predictor, model, run, covariance))


def test_the_noise_that_a_start_is_estimated_from_is_part_of_it(pendulum):
    model, predictor, run = pendulum
    random, runs, found = np.random.default_rng(2), [], []
    for _ in range(60):
        noise = {"tip": 4e-3, "pull": 3e-2}
        read = {k: run.channels[k] + s * random.normal(size=len(run)) for k, s in noise.items()}
        noisy = Experiment("run", STEP, {**run.channels, **read})
        runs.append(compare(predictor, model, noisy).free_run)
        if len(found) < 10:
            found.append(free_run_deviation(predictor, model, noisy, np.zeros((4, 4))) ** 2)
    matches(np.sqrt(np.mean(found, axis=0)), np.stack(runs), tolerance=0.25)


def test_a_fit_has_it_with_the_covariance_that_it_reports(oscillator, tmp_path):
    """A network's parameters are known within a factor; a hundredth of that is linear."""
    fit, run = oscillator.fit, oscillator.recording
    found = fit.free_run_deviation(run)
    joint = fit.learned_uncertainty.joint(fit.model, fit.covariance)
    matches(0.01 * found, drawn(fit.predictor, fit.model, run, 1e-4 * joint))
    fit.save(tmp_path)
    again = Fit.load(tmp_path)
    assert again.predictor == fit.predictor
    np.testing.assert_allclose(again.free_run_deviation(run), found, rtol=1e-6, atol=1e-12)


def test_with_the_noise_of_the_sensors_it_is_how_far_the_measurement_lies(oscillator):
    fit, noise = oscillator.fit, 2e-3
    gap = fit.comparisons[0].measured - fit.comparisons[0].free_run
    wanted = np.sqrt(np.mean(gap**2, axis=0))
    band = np.sqrt(np.mean(fit.free_run_deviation(oscillator.recording) ** 2, axis=0))
    assert (band > 0.4 * noise).all()
    np.testing.assert_allclose(np.hypot(band, noise), wanted, rtol=0.25)


def test_the_joint_covariance_has_the_reported_one_and_what_does_not_go_with_it(oscillator):
    fit, layout = oscillator.fit, Layout(oscillator.fit.model)
    ours, told = layout.physical_members, fit.learned_uncertainty
    wide, near = (told.joint(fit.model, factor * fit.covariance) for factor in (4.0, 1.0))
    raw, small = layout.raw(fit.model), 1e-6
    with float64():
        moved = [layout.plain_model(raw + small * one) for one in np.eye(layout.size)[ours]]
    slopes = np.array([[m.mass - fit.model.mass, m.damping - fit.model.damping] for m in moved])
    reported = slopes.T / small @ near[np.ix_(ours, ours)] @ slopes / small
    np.testing.assert_allclose(reported, fit.covariance, rtol=1e-4)

    def left(joint):
        """Return what of the others' covariance does not go with the physical parameters."""
        across = joint[np.ix_(~ours, ours)]
        follow = across @ np.linalg.inv(joint[np.ix_(ours, ours)])
        return joint[np.ix_(~ours, ~ours)] - follow @ across.T

    size = np.sqrt(np.outer(*[np.diag(left(near))] * 2))
    np.testing.assert_allclose(left(wide) / size, left(near) / size, atol=1e-6)


def test_of_maps_linear_in_their_parameters_horizons_that_differ_add_their_spread():
    model = Cubic(Polynomial(1, 1, np.array([[0.2, 0.5]])))
    gap = np.array([0.0, 0.1])
    told = LearnedUncertainty(
        1e-6 * np.eye(2), np.stack([0 * gap, gap]), weights=np.array([0.25, 0.75])
    )
    wanted = 1e-6 * np.eye(2) + np.outer(gap, gap) * 0.25 * 0.75
    np.testing.assert_allclose(told.joint(model, np.empty((0, 0))), wanted)


def test_what_is_not_known_is_infinite(pendulum):
    model, predictor, run = pendulum
    unknown = LearnedUncertainty(np.eye(4), np.zeros((1, 4)), np.ones(1))
    joint = unknown.joint(model, np.diag([1.0, np.inf, 1.0, 1.0]))
    assert np.isinf(free_run_deviation(predictor, model, run, joint)).all()


def test_a_fit_of_another_method_says_that_it_cannot_predict(machine_fit, unseen_run):
    with pytest.raises(InputError, match="must have a predictor"):
        machine_fit.free_run_deviation(unseen_run)
