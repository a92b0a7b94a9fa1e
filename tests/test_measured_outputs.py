"""A pendulum of which no state is a channel, from a recording to its report, by default.

What is measured is where its tip is and what an accelerometer there reads, in different units.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from penode import Experiment, Fit, Model, identify, ladder_plan, nuisance, physical
from penode.arrays import Leaf
from penode.engine import default_plan
from penode.horizon.initial_states import initial_states
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.report.fit_report import fit_report
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt
from penode.validation.free_run import compare

STEP, SAMPLES = 0.02, 1500
TRUTH = {"stiffness": 9.0, "damping": 0.5, "length": 0.7, "offset": 0.05}
START = {"angle": 0.4, "rate": 0.6}


class Pendulum(Model):
    """angle'' = torque - stiffness sin(angle) - damping angle'."""

    states: ClassVar = ("angle", "rate")
    inputs: ClassVar = ("torque",)
    state_units: ClassVar = ("rad", "rad/s")
    outputs: ClassVar = {"tip": "m", "pull": "m/s2"}

    stiffness: Leaf = physical("1/s2")
    damping: Leaf = physical("1/s")
    length: Leaf = physical("m")
    offset: Leaf = physical("m")

    def derivative(self, x, u):
        pull = self.stiffness * jnp.sin(x[0]) + self.damping * x[1]
        return jnp.stack([x[1], u["torque"] - pull])

    def output(self, x, u):
        tip = self.length * jnp.sin(x[0]) + self.offset
        return jnp.stack([tip, self.length * x[1] ** 2])


def slope(x, torque):
    return np.array([x[1], torque - 9.0 * np.sin(x[0]) - 0.5 * x[1]])


def recorded(seed, samples=SAMPLES):
    """Record 4 mm and 0.03 m/s2 of noise, integrated four times as finely."""
    random, h = np.random.default_rng(seed), STEP / 4
    torque = random.uniform(-4.0, 4.0, samples // 30).repeat(30)
    x, path = np.array(list(START.values())), []
    for push in torque:
        path.append(x)
        for _ in range(4):
            k1 = slope(x, push)
            k2 = slope(x + h / 2 * k1, push)
            k3 = slope(x + h / 2 * k2, push)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(x + h * k3, push))
    angle, rate = np.array(path).T
    noise = random.normal(size=(2, samples))
    tip = 0.7 * np.sin(angle) + 0.05 + 0.004 * noise[0]
    pull = 0.7 * rate**2 + 0.03 * noise[1]
    return Experiment(f"run {seed}", STEP, {"torque": torque, "tip": tip, "pull": pull}), path


@pytest.fixture(scope="module")
def fit():
    run, unseen = recorded(3)[0], recorded(4)[0]
    plan = ladder_plan((10, 40, 160, 500))
    return identify(Pendulum(7.0, 0.2, 1.0, 0.0), [run], plan=plan, validation=[unseen])


def test_the_first_window_shows_more_than_its_start():
    first = default_plan(Pendulum(7.0, 0.2, 1.0, 0.0), [recorded(3)[0]]).stages[0].horizon
    assert 2 * (first + 1) >= 4 * 2


def test_parameters_of_equation_and_sensors_are_as_sure_as_they_say(fit):
    assert fit.horizon.verdict == "plateau"
    for name, truth in TRUTH.items():
        found = fit.parameters[name]
        assert abs(found.value - truth) < 3 * found.std < 0.02 * max(truth, 0.1)


def test_initial_states_are_known_as_well_as_their_deviations_say(fit):
    assert list(fit.initial_states) == ["run 3"]
    for name, unit in (("angle", "rad"), ("rate", "rad/s")):
        found = fit.initial_states["run 3"][name]
        assert abs(found.value - START[name]) < 3 * found.std < 0.02
        assert found.unit == unit
        assert fit.result()["initial_states"]["run 3"][name]["value"] == found.value


def test_predictions_are_of_the_outputs_in_their_units(fit):
    trained, unseen = fit.comparisons
    for one in (trained, unseen):
        assert (one.states, one.units) == (("tip", "pull"), ("m", "m/s2"))
        assert one.free_run_errors["tip"] == pytest.approx(0.004, rel=0.1)
        assert one.free_run_errors["pull"] == pytest.approx(0.03, rel=0.1)
    np.testing.assert_array_equal(trained.measured[:, 0], recorded(3)[0].channels["tip"])
    assert "one step" not in repr(fit)
    assert "tip free run 0.004" in repr(fit)
    assert set(fit.horizon.ladder[0].free_run_errors) == {"tip", "pull"}


def test_the_excited_region_is_that_of_the_states_that_windows_find(fit):
    path = np.array(recorded(3)[1])
    spread = np.ptp(fit.excited, axis=0) / np.ptp(path, axis=0)
    np.testing.assert_allclose(spread, 1.0, atol=0.15)


def test_report_and_archive_have_the_outputs(fit, tmp_path):
    page = fit_report(fit)
    assert "could not be made" not in page
    assert "the model sees torque and the initial state that fits it best" in page
    rms = f"{fit.comparisons[0].free_run_errors['tip']:.3g}"
    assert f"tip\N{NO-BREAK SPACE}{rms}\N{NO-BREAK SPACE}m" in page
    fit.save(tmp_path)
    again = Fit.load(tmp_path, trust=True)
    assert again.initial_states == fit.initial_states
    assert again.result()["parameters"] == fit.result()["parameters"]


# --- initial states against SciPy -----------------------------------------------------------------


class Decay(Model):
    """x' = u - a x, of which twice the value is measured, with an offset of each recording."""

    states: ClassVar = ("x",)
    inputs: ClassVar = ("u",)
    state_units: ClassVar = ("V",)
    outputs: ClassVar = {"y": "V"}

    a: Leaf = physical("1/s")
    b: Leaf = nuisance("V")

    def derivative(self, x, u):
        return u[0] - self.a * x

    def output(self, x, u):
        return 2.0 * x + self.b


def test_deviations_of_initial_states_are_those_of_the_joint_least_squares():
    """The noise is white, and the start follows the parameters by -(S'S)^-1 S'S_theta."""
    random, runs, a, offsets = np.random.default_rng(5), [], 0.5, (0.3, -0.2)
    kept, inputs = np.exp(-a * 0.1), random.normal(size=(2, SAMPLES))
    for u, b, first in zip(inputs, offsets, (2.0, -1.0), strict=True):
        x = [first]
        for push in u[:-1]:
            x.append(kept * x[-1] + (1 - kept) / a * push)
        y = 2 * np.array(x) + b + 0.05 * random.normal(size=SAMPLES)
        runs.append(Experiment(f"run {b}", 0.1, {"y": y, "u": u}))

    def residual(both):
        rows = []
        for k, run in enumerate(runs):
            x, path, kept = both[3 + k], [], np.exp(-both[0] * 0.1)
            for push in run.channels["u"]:
                path.append(x)
                x = kept * x + (1 - kept) / both[0] * push
            rows.append(run.channels["y"] - 2 * np.array(path) - both[1 + k])
        return np.concatenate(rows)

    joint = least_squares(residual, [a, *offsets, 2.0, -1.0], xtol=1e-12)
    normal, variance = joint.jac.T @ joint.jac, 2 * joint.cost / len(joint.fun)
    follow = np.linalg.solve(normal[3:, 3:], normal[3:, :3])
    noise = np.diag(np.linalg.inv(normal[3:, 3:])) * variance
    plan = Plan((Stage(50, LevenbergMarquardt()),))
    problem = LadderProblem.of(Decay(a, 0.0), runs, plan, ignore_events)
    raw, layout = joint.x[:3], problem.objective.layout
    assert layout.raw_names == ("a", "b", "b")
    own = [layout.plain_model(raw, k) for k in range(2)]
    predictor = problem.objective.predictor
    seen = [compare(predictor, one, run, "train") for one, run in zip(own, runs, strict=True)]
    for size, tolerance in ((1e-4, 0.1), (1e8, 1e-5)):  # of noise alone, of parameters alone
        covariance = size * np.linalg.inv(normal[:3, :3]) * variance
        expected = np.sqrt(noise + np.diag(follow @ covariance @ follow.T))
        found = initial_states(problem, raw, covariance, seen)
        for k, run in enumerate(runs):
            one = found[run.name]["x"]
            assert one.value == pytest.approx(joint.x[3 + k], abs=1e-5)
            assert one.std == pytest.approx(expected[k], rel=tolerance)
    unknown = initial_states(problem, raw, np.full((3, 3), np.inf), seen)
    assert unknown[runs[0].name]["x"].std == np.inf
