"""The voltage equation and the flux maps against closed forms."""

import jax
import numpy as np
import pytest

from penode.arrays import float64
from penode.models.inputs import Inputs
from penode.models.networks import ConvexGradient
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.flux_maps import FLUX_MAPS, FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance

CURRENTS = np.random.default_rng(3).uniform(-300, 300, (2, 50))


def linear_machine(l_d: float, l_q: float, magnet: float, resistance: float) -> Machine:
    """A machine without saturation: the network's gains are as good as zero."""
    network = ConvexGradient(
        offset=np.array([magnet, 0.0]),
        stiffness=np.diag([l_d, l_q]),
        directions=np.ones((1, 2)),
        bias=np.zeros(1),
        gain=np.array([1e-30]),
    )
    return Machine(FluxMap(network, 1.0, 1.0), (Resistance(resistance),))


def test_derivative_is_the_linear_machines_closed_form():
    l_d, l_q, magnet, resistance, omega = 300e-6, 500e-6, 0.05, 0.01, -785.0
    machine = linear_machine(l_d, l_q, magnet, resistance)
    u = np.stack([np.full(50, 12.0), np.full(50, -30.0), np.full(50, omega)])
    derivative = jax.jit(lambda machine, x, u: with_batch_axis(machine).derivative(x, u))
    with float64():
        rate = derivative(machine, CURRENTS, Inputs(u, machine.inputs))
    i_d, i_q = CURRENTS
    expected_d = (12.0 - resistance * i_d + omega * l_q * i_q) / l_d
    expected_q = (-30.0 - resistance * i_q - omega * (l_d * i_d + magnet)) / l_q
    np.testing.assert_allclose(rate, np.stack([expected_d, expected_q]), rtol=1e-12)


@pytest.mark.parametrize("kind", FLUX_MAPS)
def test_inductance_is_the_slope_of_the_flux_linkage(kind):
    machine = Machine(FluxMap(FLUX_MAPS[kind].draw(1), 300.0, 0.1), (Resistance(0.01),))
    maps = machine.maps()
    inductance = maps["differential_inductance"](*CURRENTS)
    for column, step in enumerate(np.eye(2) * 1e-3):
        ahead = maps["flux_map"](*(CURRENTS + step[:, None]))
        behind = maps["flux_map"](*(CURRENTS - step[:, None]))
        np.testing.assert_allclose(
            inductance[:, column], (ahead - behind) / 2e-3, rtol=1e-6, atol=1e-11
        )


@pytest.mark.parametrize("kind", [name for name, kind in FLUX_MAPS.items() if kind.reciprocal])
@pytest.mark.parametrize("seed", range(5))
def test_reciprocal_maps_have_symmetric_positive_definite_inductance(kind, seed):
    machine = Machine(FluxMap(FLUX_MAPS[kind].draw(seed), 300.0, 0.1), (Resistance(0.01),))
    far = np.concatenate([CURRENTS, 100 * CURRENTS], axis=1)
    inductance = machine.maps()["differential_inductance"](*far)
    np.testing.assert_allclose(inductance[0, 1], inductance[1, 0], rtol=1e-12, atol=1e-18)
    assert np.linalg.eigvalsh(inductance.transpose(2, 0, 1)).min() > 0


def test_maps_keep_the_shape_of_the_currents():
    maps = linear_machine(3e-4, 5e-4, 0.05, 0.01).maps()
    grid = np.meshgrid(np.linspace(-1, 1, 4), np.linspace(-1, 1, 3))
    assert maps["flux_map"](*grid).shape == (2, 3, 4)
    assert maps["differential_inductance"](10.0, np.arange(5.0)).shape == (2, 2, 5)
    np.testing.assert_allclose(maps["flux_map"](100.0, -50.0), [0.08, -0.025], rtol=1e-12)
    assert maps["flux_map"](np.zeros(0), 1.0).shape == (2, 0)


def test_maps_take_any_number_of_points_each_by_itself():
    maps = linear_machine(3e-4, 5e-4, 0.05, 0.01).maps()
    i_d, i_q = np.linspace(-200, 50, 9000).reshape(2, 3, 1500), 80.0
    psi = maps["flux_map"](i_d, i_q)
    np.testing.assert_allclose(psi[0], 0.05 + 3e-4 * i_d, rtol=0, atol=1e-15)
    np.testing.assert_allclose(psi[1], np.full(i_d.shape, 0.04), rtol=1e-12)
