"""What stands still between two samples: closed forms, and the bench's own holds."""

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Predictor
from penode.arrays import float64
from penode.models.networks import ConvexGradient
from penode.pmsm.bench.drive import Drive
from penode.pmsm.bench.inverter import Inverter, RotorHold, StationaryHold
from penode.pmsm.bench.machines import Machine as BenchMachine
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import simulate
from penode.pmsm.flux_maps import FluxMap
from penode.pmsm.holds import HOLDS, RotorFrame, StationaryFrame
from penode.pmsm.model import Machine
from penode.predictors.holds import ZeroOrder
from penode.validation.free_run import compare

T = 1e-4
L_D, L_Q, MAGNET, RESISTANCE = 200e-6, 450e-6, 0.05, 0.012
INPUT = np.array([[30.0, -5.0], [40.0, 12.0], [3000.0, -700.0], [1.3, 6.1]])


def asked(hold, share, rows=4):
    with float64():
        return np.asarray(hold(lambda offset: jnp.asarray(INPUT[:rows]) + offset, 0, share, T))


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_a_dq_hold_turns_the_angle_alone(share):
    found = asked(RotorFrame(), share)
    np.testing.assert_array_equal(found[:3], INPUT[:3])
    np.testing.assert_allclose(found[3], INPUT[3] + share * T * INPUT[2], rtol=1e-15)


@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_a_stationary_hold_keeps_the_voltage_vector_in_alpha_and_beta(share, rows):
    found = asked(StationaryFrame(), share, rows)
    assert len(found) == rows
    at_sample = (INPUT[0] + 1j * INPUT[1]) * np.exp(1j * INPUT[3])
    ahead = INPUT[3] + share * T * INPUT[2]
    np.testing.assert_allclose((found[0] + 1j * found[1]) * np.exp(1j * ahead), at_sample)
    np.testing.assert_array_equal(found[2], INPUT[2])
    if rows == 4:
        np.testing.assert_allclose(found[3], ahead, rtol=1e-15)


def test_both_read_the_sample_they_are_asked_for():
    for hold in HOLDS.values():
        with float64():
            found = hold(lambda offset: jnp.asarray(INPUT) + offset, -2, 0.0, T)
        np.testing.assert_array_equal(found, INPUT - 2)


# --- against the bench ------------------------------------------------------------------------


def linear_coenergy(i_d, i_q, theta_el):
    return MAGNET * i_d + 0.5 * (L_D * i_d**2 + L_Q * i_q**2)


BENCH = BenchMachine("linear", RESISTANCE, 4, 200.0, MAGNET, L_D, L_Q, (), linear_coenergy)


NETWORK = ConvexGradient(
    np.array([MAGNET, 0.0]), np.diag([L_D, L_Q]), np.ones((1, 2)), np.zeros(1), np.array([1e-30])
)
MACHINE = Machine(FluxMap(NETWORK, 1.0, 1.0), R=RESISTANCE)


@pytest.mark.parametrize("inverter", [RotorHold(), StationaryHold()], ids=lambda h: h.frame)
def test_only_the_matching_hold_predicts_the_bench(inverter):
    drive = Drive(inverter=Inverter(inverter), dc_voltage=800.0)
    reference = Lissajous(100.0, 140.0, 150.0)
    run = simulate(BENCH, reference, speed_rpm=3000.0, duration=0.05, drive=drive)
    error = {
        name: compare(Predictor(T, hold=hold), MACHINE, run, "train").free_run_rmse
        for name, hold in {**HOLDS, "plain": ZeroOrder()}.items()
    }
    matching = error.pop(inverter.frame)
    assert matching < 1e-3
    assert error.pop({"dq": "stationary", "stationary": "dq"}[inverter.frame]) > 1.0
    if inverter.frame == "dq":
        assert error["plain"] == matching
