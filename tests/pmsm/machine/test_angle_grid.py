"""The map over currents and angle against the closed form of its coenergy, by complex steps."""

from dataclasses import replace

import numpy as np
import pytest

from penode.models.networks import ConvexGradient
from penode.pmsm.machine.angle_grid import over_angle
from penode.pmsm.machine.flux_grid import tabulate
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance

ORDERS, SCALE, FLUX, POLE_PAIRS = (6, 12), 300.0, 0.08, 4


def turning_by(machine_fit, size):
    network = ConvexGradient.random(2, 7, 3, 2 * len(ORDERS))
    shifts = size * np.random.default_rng(3).normal(size=network.modulation.shape)
    network = replace(network, modulation=shifts, offset=np.array([0.4, -0.1]))
    flux = FluxMap(network, SCALE, FLUX, ORDERS)
    return replace(machine_fit, model=Machine(flux, (Resistance(0.01),)), provenance={})


@pytest.fixture(scope="module")
def turning(machine_fit):
    """Return a fit whose map has large harmonics of the angle."""
    return turning_by(machine_fit, 0.4)


def coenergy(network, currents, theta):
    """Return W (point,) in Ws at complex currents (2, point) and one complex angle in rad."""
    orders, x = np.array(ORDERS), currents / SCALE
    waves = np.concatenate([np.cos(orders * theta), np.sin(orders * theta)])
    hidden = network.directions @ x + (network.bias + network.modulation @ waves)[:, None]
    quadratic = 0.5 * np.sum(x * (network.stiffness @ x), axis=0)
    return FLUX * SCALE * (network.offset @ x + quadratic + network.gain @ np.log(np.cosh(hidden)))


def slope(network, currents, theta, tiny=1e-30):
    """Return dW/dtheta (point,) in Ws beyond that at no current."""
    complex_theta = theta + 1j * tiny
    with_current = coenergy(network, currents, complex_theta)
    without = coenergy(network, 0 * currents, complex_theta)
    return (with_current.imag - without.imag) / tiny


def test_flux_and_torque_over_the_angle_are_slopes_of_one_coenergy(turning):
    grid = tabulate(turning, 7, POLE_PAIRS)
    found = over_angle(turning, grid)
    assert (found.angle[0], found.angle[-1], len(found.angle)) == (0.0, 360.0, 97)
    network, currents = turning.model.flux.network, grid.mesh.reshape(2, -1)
    for k in (0, 5, 20, 50, 96):
        theta = np.deg2rad(found.angle[k])
        shifts = 1e-30j * np.eye(2)[:, :, None]
        psi = np.stack([coenergy(network, currents + one, theta).imag / 1e-30 for one in shifts])
        np.testing.assert_allclose(found.psi[..., k].reshape(2, -1), psi, rtol=0, atol=1e-14)
        cross = psi[0] * currents[1] - psi[1] * currents[0]
        torque = 1.5 * POLE_PAIRS * (cross + slope(network, currents, theta))
        error = np.abs(found.torque[..., k].ravel() - torque).max()
        assert error < 1e-9 * np.abs(torque).max()


def test_the_mean_over_a_turn_is_the_table_without_the_angle(machine_fit):
    turning = turning_by(machine_fit, 0.02)
    grid = tabulate(turning, 7, POLE_PAIRS)
    found = over_angle(turning, grid)
    np.testing.assert_allclose(found.psi[..., 1:].mean(axis=-1), grid.psi, rtol=1e-6, atol=1e-9)
    mean = found.torque[..., 1:].mean(axis=-1)
    np.testing.assert_allclose(mean, grid.torque, rtol=1e-6, atol=1e-6 * np.abs(mean).max())


def test_a_map_without_the_angle_and_a_machine_without_pole_pairs(machine_fit, turning):
    assert over_angle(machine_fit, tabulate(machine_fit, 7, POLE_PAIRS)) is None
    assert over_angle(turning, tabulate(turning, 7)).torque is None
