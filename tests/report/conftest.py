"""A synthetic identification of something that is no motor: a cart with mass and friction."""

from types import SimpleNamespace

import numpy as np
import pytest

from penode.fit.fit import Estimate, HorizonChoice, HorizonSummary
from penode.validation.comparison import Comparison
from penode.validation.residual_tests import Spectrum

HORIZONS = (1, 2, 5, 10, 20, 50, 100)


def rung(horizon, mass, std, free_run_rmse=0.02):
    parameters = {"mass": mass, "friction": 3.2e-3}
    deviations = {"mass": std, "friction": 1e-4}
    return HorizonSummary(horizon, parameters, deviations, 0.013, free_run_rmse, 7, "Converged.")


@pytest.fixture
def choice():
    masses = (1.9, 1.31, 1.105, 1.021, 1.019, 1.018, 1.02)
    ladder = tuple(rung(h, m, 0.004) for h, m in zip(HORIZONS, masses, strict=True))
    return HorizonChoice(50, "plateau", "Four horizons agree.", ladder, (10, 20, 50, 100))


@pytest.fixture
def comparison():
    rng = np.random.default_rng(7)
    time = np.arange(10_000) * 1e-3
    measured = np.stack([np.sin(3 * time), 3 * np.cos(3 * time)], axis=1)
    one_step = measured + rng.normal(0, 0.01, measured.shape)
    free_run = measured + 0.05 * np.sin(0.7 * time)[:, None]
    states, units = ("x", "v"), ("m", "m/s")
    return Comparison("cart.csv", "train", 1e-3, states, units, measured, one_step, free_run)


@pytest.fixture
def spectrum():
    frequency = np.arange(12_001) / 24.0
    amplitude = np.full((frequency.size, 2), 1e-3)
    amplitude[24 * 50, 0] = 0.4
    return Spectrum("cart.csv", frequency, amplitude)


@pytest.fixture
def fit(choice, comparison, spectrum):
    return SimpleNamespace(
        stationary=None,
        parameters={
            "mass": Estimate(1.018, 0.004, (1.010, 1.026), "kg", 0.9),
            "friction": Estimate(3.2e-3, 1e-4, (3.0e-3, 3.4e-3), "Ns/m"),
        },
        covariance=np.array([[1.6e-5, 2e-7], [2e-7, 1e-8]]),
        correlation=np.array([[1.0, 0.5], [0.5, 1.0]]),
        horizon=choice,
        comparisons=(comparison,),
        spectrum=spectrum,
        warnings=(),
        provenance={},
    )
