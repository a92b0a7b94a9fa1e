"""Models of the same recordings side by side: counts, errors, and which one the criterion takes."""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, Fit, InputError, Model, identify, ladder_plan, physical
from penode.arrays import Leaf
from penode.validation.autocovariance import effective_number

STEP, SAMPLES, NOISE = 0.05, 1200, 0.02


class Tank(Model):
    """x' = u - a x."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    a: Leaf = physical("1/s")

    def derivative(self, x, u):
        return jnp.stack([u["u"] - self.a * x[0]])


class Curved(Tank):
    """x' = u - a x - b x^2."""

    b: Leaf = physical("1/(m s)")

    def derivative(self, x, u):
        return jnp.stack([u["u"] - self.a * x[0] - self.b * x[0] ** 2])


def recorded(name, curve, seed, correlation=0.0):
    """Record x from rest with noise of the sensor, correlated from sample to sample."""
    random, x, path = np.random.default_rng(seed), 0.0, []
    u = random.uniform(0.0, 2.0, SAMPLES // 20).repeat(20)
    for push in u:
        path.append(x)
        for _ in range(10):
            x += STEP / 10 * (push - 0.8 * x - curve * x**2)
    noise = np.zeros(SAMPLES)
    for k in range(1, SAMPLES):
        fresh = np.sqrt(1 - correlation**2) * random.normal()
        noise[k] = correlation * noise[k - 1] + fresh
    return Experiment(name, STEP, {"x": np.array(path) + NOISE * noise, "u": u})


def fits(curve, **options):
    runs = [recorded(name, curve, k, **options) for k, name in enumerate(("run", "unseen"))]
    starts = {"straight": Tank(1.0), "curved": Curved(1.0, 0.0)}
    plan = ladder_plan((8, 24))
    return {
        name: identify(start, runs[:1], plan=plan, validation=runs[1:])
        for name, start in starts.items()
    }


@pytest.fixture(scope="module")
def straight():
    return fits(curve=0.0)


def test_the_model_that_made_the_recordings_has_the_least_criterion(straight):
    for made, found in ((0, straight), (1, fits(curve=0.1))):
        frame = Fit.compare_models(found)
        assert frame["model"].to_list() == ["straight", "curved"]
        assert frame["parameters"].to_list() == [1, 2]
        assert frame["bic_above_least"][made] == 0
        assert frame["bic_above_least"][1 - made] > 2


def test_errors_are_those_of_the_recordings_in_the_units_of_the_quantities(straight):
    row = Fit.compare_models(straight).row(0, named=True)
    train, unseen = straight["straight"].comparisons
    for role, one in (("train", train), ("validation", unseen)):
        assert row[f"{role}_free_run_x"] == pytest.approx(one.free_run_errors["x"])
        assert row[f"{role}_one_step_x"] == pytest.approx(one.one_step_errors["x"])
    assert row["verdict"] == straight["straight"].horizon.verdict
    assert row["horizon"] == straight["straight"].horizon.selected
    assert row["effective_number"] == pytest.approx(SAMPLES, rel=0.15)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
def test_the_effective_number_of_a_first_order_series_is_the_known_one(correlation):
    random, count = np.random.default_rng(3), 40_000
    series = np.zeros(count)
    for k in range(1, count):
        series[k] = correlation * series[k - 1] + random.normal()
    wanted = count * (1 - correlation) / (1 + correlation)
    assert effective_number(series) == pytest.approx(wanted, rel=0.12)
    assert effective_number(0 * series) == count
    assert np.isnan(effective_number(series * np.nan))


def test_a_run_that_diverges_has_no_error_and_no_criterion(straight):
    train, unseen = straight["curved"].comparisons
    lost = replace(train, free_run=np.full_like(train.free_run, np.nan))
    broken = {**straight, "curved": replace(straight["curved"], comparisons=(lost, unseen))}
    row = Fit.compare_models(broken).row(1, named=True)
    assert row["train_free_run_x"] is None
    assert row["bic"] is None
    assert row["bic_above_least"] is None
    assert Fit.compare_models(broken)["bic_above_least"][0] == 0


def test_other_recordings_are_refused(straight):
    other = replace(straight["curved"], comparisons=straight["curved"].comparisons[:1])
    with pytest.raises(InputError, match="same recordings and quantities, got others of b than"):
        Fit.compare_models({"a": straight["straight"], "b": other})
    with pytest.raises(InputError, match="must be of one fit or more"):
        Fit.compare_models({})
    untrained = replace(other, comparisons=straight["curved"].comparisons[1:])
    with pytest.raises(InputError, match="a: a fit must have training recordings"):
        Fit.compare_models({"a": untrained})


def test_estimated_starts_and_values_of_each_recording_count(oscillator):
    fit = oscillator.fit
    starts = {"train.csv": {"x": fit.parameters["mass"], "v": fit.parameters["mass"]}}
    plain, started = fit, replace(fit, initial_states=starts)
    counts = Fit.compare_models({"plain": plain, "started": started})["parameters"].to_list()
    assert counts == [12, 14]
