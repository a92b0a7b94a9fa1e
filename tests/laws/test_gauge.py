"""At constant speed a wrong resistance hides in a map with a skew Jacobian (METHOD section 3).

R + dR with psi + (dR / omega) J i leaves R i + omega J psi as it is; what is left to tell them
apart is (dR / omega) J di/dt.
"""

from dataclasses import replace

import numpy as np
import pytest

from penode.arrays import float64
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance

J = np.array([[0.0, -1.0], [1.0, 0.0]])
OMEGA, EXTRA = 210.0, 0.03


@pytest.fixture(scope="module")
def machine(systems):
    return systems["coenergy machine"].model


@pytest.fixture(scope="module")
def gauged(machine):
    """Return the machine with R + dR and the map psi + (dR / omega) J i."""
    flux = machine.flux
    skew = EXTRA / OMEGA * flux.current_scale / flux.flux_scale * J
    network = replace(flux.network, stiffness=flux.network.stiffness + skew)
    return Machine(replace(flux, network=network), (Resistance(machine.terms[0].R + EXTRA),))


@pytest.fixture
def case(rng):
    """Return currents (2, 50) in A and inputs (3, 50) at one speed."""
    voltages = rng.uniform(-40, 40, (2, 50))
    return rng.uniform(-80, 80, (2, 50)), np.vstack([voltages, np.full((1, 50), OMEGA)])


def derivative(model, currents, inputs):
    with float64():
        return np.asarray(with_batch_axis(model).derivative(currents, Inputs(inputs, model.inputs)))


def test_the_gauged_map_is_psi_plus_the_rotated_current(machine, gauged, case):
    currents, _ = case
    shift = gauged.maps()["flux_map"](*currents) - machine.maps()["flux_map"](*currents)
    np.testing.assert_allclose(shift, EXTRA / OMEGA * J @ currents, rtol=0, atol=1e-12)


def test_only_the_rotated_current_slope_tells_them_apart(machine, gauged, case):
    """v = L di/dt is common to both, and the gauged L has (dR / omega) J beside it."""
    free, gauged_slope = (derivative(m, *case) for m in (machine, gauged))
    inductance = machine.maps()["differential_inductance"](*case[0])
    common = np.einsum("ijb,jb->ib", inductance, free)
    left = common - np.einsum("ijb,jb->ib", inductance, gauged_slope)
    np.testing.assert_allclose(
        left, EXTRA / OMEGA * J @ gauged_slope, rtol=0, atol=1e-12 * np.abs(common).max()
    )
    assert np.abs(left).max() > 1e-2 * np.abs(common).max()


def test_without_a_current_slope_nothing_does(machine, gauged, case):
    """Voltages that hold the current: the gauged machine stands still on them too."""
    currents, inputs = case
    psi = machine.maps()["flux_map"](*currents)
    holding = np.vstack([machine.terms[0].R * currents + OMEGA * J @ psi, inputs[2:]])
    for model in (machine, gauged):
        assert np.abs(derivative(model, currents, holding)).max() < 1e-9


def test_skew_read_out_gives_the_resistance_back(machine, gauged, case):
    """R + omega s with s = mean(d psi_d / d i_q - d psi_q / d i_d) / 2."""
    for model in (machine, gauged):
        inductance = model.maps()["differential_inductance"](*case[0])
        skew = np.mean(inductance[0, 1] - inductance[1, 0]) / 2
        assert model.terms[0].R + OMEGA * skew == pytest.approx(machine.terms[0].R, abs=1e-12)
    assert gauged.terms[0].R > machine.terms[0].R + 0.9 * EXTRA


def test_at_another_speed_the_gauge_shows(machine, gauged, case):
    currents, inputs = case
    psi = machine.maps()["flux_map"](*currents)
    holding = np.vstack([machine.terms[0].R * currents - OMEGA * J @ psi, -inputs[2:]])
    assert np.abs(derivative(machine, currents, holding)).max() < 1e-9
    assert np.abs(derivative(gauged, currents, holding)).max() > 100.0
