"""The convex start: what the weak form finds before any training."""

import numpy as np
import pytest

from penode.bench.coenergy_table import true_flux_map
from penode.bench.machines import TRACTION_300A
from penode.pmsm.balance.start import weak_start
from penode.pmsm.balance.voltage_balance import PolynomialMap, harmonic_window


@pytest.mark.parametrize("reciprocal", [True, False])
def test_polynomial_basis_is_reciprocal_where_it_says_so(reciprocal):
    polynomial = PolynomialMap(reciprocal, 200.0)
    points = np.random.default_rng(0).uniform(-150, 150, (20, 2))
    step = 1e-3
    along_q = polynomial.basis(points + np.array([0, step])) - polynomial.basis(
        points - np.array([0, step])
    )
    along_d = polynomial.basis(points + np.array([step, 0])) - polynomial.basis(
        points - np.array([step, 0])
    )
    skew = (along_q[:, 0] - along_d[:, 1]) / (2 * step)
    largest = np.abs(along_d).max() / (2 * step)
    assert (np.abs(skew).max() < 1e-8 * largest) == reciprocal


def test_weak_start_finds_resistance_and_map_of_the_bench(slow_run):
    machine, balance, _ = weak_start([slow_run], "coenergy")
    assert abs(float(machine.terms[0].R) / TRACTION_300A.resistance - 1) < 0.01
    points = slow_run.stack(("i_d", "i_q"))[::50]
    error = machine.maps()["flux_map"](*points.T).T - true_flux_map(TRACTION_300A, *points.T)
    assert np.abs(error).mean() < 0.003 * TRACTION_300A.magnet_flux_linkage
    assert balance.independence["R"] > 0.3


def test_unconstrained_map_at_one_speed_hides_the_resistance(slow_run, fast_run):
    assert weak_start([slow_run], "mlp")[1].independence["R"] < 1e-3
    assert weak_start([fast_run], "mlp")[1].independence["R"] > 0.1


def test_harmonic_window_is_two_periods_of_the_sixth_harmonic(slow_run):
    electrical_period = 1 / (1500 / 60 * TRACTION_300A.pole_pairs) / slow_run.time_step
    assert harmonic_window(slow_run) == round(electrical_period / 3)
