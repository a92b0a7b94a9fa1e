"""The profile of the likelihood, beside sums of squares in closed form."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, InputError, Model, identify, physical
from penode.arrays import Leaf
from penode.data.windows import Contiguous
from penode.engine import LevenbergMarquardt, Positive, Profile, profile
from penode.training.plan import Plan, Stage

STEP, RATE, GAIN = 0.1, 0.7, 2.0


class Decay(Model):
    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("V",)

    rate: Leaf = physical("1/s", Positive())
    gain: Leaf = physical("V/V")

    def derivative(self, x, u):
        return jnp.stack([self.rate * (self.gain * u[0] - x[0])])


@pytest.fixture(scope="module")
def run():
    random = np.random.default_rng(3)
    u, x = np.sign(random.normal(size=40)).repeat(5), [0.0]
    for held in u[:-1]:
        x.append(held * GAIN + (x[-1] - held * GAIN) * np.exp(-RATE * STEP))
    return Experiment("run", STEP, {"x": np.array(x) + 0.05 * random.normal(size=200), "u": u})


#: One step ahead from what was measured.
PLAN = Plan((Stage(1, LevenbergMarquardt(60)),), Contiguous())


@pytest.fixture(scope="module")
def fit(run):
    return identify(Decay(1.0, 1.0), [run], plan=PLAN)


def kept(rate):
    """What a classic Runge-Kutta step keeps of x: 1 + z + z^2/2 + z^3/6 + z^4/24."""
    z = -rate * STEP
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24


def errors(parameters, run):
    """One-step errors of a rate and a gain."""
    rate, gain = parameters
    x, u = run.channels["x"], run.channels["u"]
    return x[1:] - kept(rate) * x[:-1] - (1 - kept(rate)) * gain * u[:-1]


def least_squares(run, rate):
    """The least sum of squares at a rate, the gain estimated: one linear column."""
    left, column = errors((rate, 0.0), run), (1 - kept(rate)) * run.channels["u"][:-1]
    return np.sum((left - column * (column @ left) / (column @ column)) ** 2)


def test_it_is_that_of_least_squares_with_the_other_parameter_estimated(run, fit):
    found = profile(fit, [run], "rate", reach=4.0, points=8, plan=PLAN)
    sums = np.array([least_squares(run, rate) for rate in found.values])
    rise = sums - sums[8]
    rise *= 0.5**2 / np.mean(rise[[7, 9]])
    np.testing.assert_allclose(found.rise, rise, rtol=1e-4, atol=1e-5)
    low, high = found.interval_95
    deviation = fit.horizon.ladder[0].std["rate"]
    assert abs(found.values[8] - fit.parameters["rate"].value) < 0.01 * deviation
    assert low == pytest.approx(found.values[8] - 1.96 * deviation, rel=0.02)
    assert high == pytest.approx(found.values[8] + 1.96 * deviation, rel=0.02)
    assert found.unit == "1/s"


def test_beyond_a_bound_nothing_is_likely(run, fit):
    deviation = fit.horizon.ladder[0].std["rate"]
    far = 1.4 * fit.parameters["rate"].value / deviation
    found = profile(fit, [run], "rate", reach=far, points=3, plan=PLAN)
    assert found.values[0] < 0
    assert found.rise[0] == np.inf
    assert np.isfinite(found.rise[1:]).all()


def test_a_side_that_stays_below_is_open():
    values = np.arange(-3.0, 4.0)
    flat = Profile("k", "1", values, np.where(values < 0, values**2, 0.1 * values))
    low, high = flat.interval_95
    assert low == pytest.approx(-1.96)
    assert high == np.inf


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"parameter": "rat"}, "parameter must be one of rate, gain, got 'rat' .did you mean rate"),
        ({"points": 1}, "points must be >= 2 and reach > 0, got 1 and 3"),
        ({"reach": 0.0}, "got 4 and 0"),
    ],
)
def test_bad_requests_are_refused(run, fit, changed, words):
    asked = {"parameter": "rate", "plan": PLAN} | changed
    with pytest.raises(InputError, match=words):
        profile(fit, [run], **asked)
