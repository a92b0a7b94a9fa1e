"""The current controller against its own specification."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.bench.current_controller import CurrentController
from penode.bench.drive import Drive
from penode.bench.inverter import Hexagon
from penode.bench.machines import TRACTION_300A
from penode.bench.sensors import Reading

STEP = jax.jit(lambda controller, *inputs: controller.step(*inputs))
LIMIT = 400.0 / 3**0.5


@pytest.fixture
def controller():
    return CurrentController.tuned(TRACTION_300A, Drive(bandwidth=1000.0, tuning=0.8))


def step(controller, integral, reference, current, omega_el):
    with jax.enable_x64(True):
        reading = Reading(jnp.asarray(current), jnp.zeros(()), jnp.asarray(omega_el))
        voltage, integral = STEP(
            controller, jnp.asarray(integral), jnp.asarray(reference), reading, jnp.zeros(())
        )
    return np.asarray(voltage), np.asarray(integral)


def test_believed_inductance_is_the_mistuned_data_sheet(controller):
    np.testing.assert_allclose(controller.inductance, [0.8 * 180e-6, 0.8 * 450e-6])


def test_without_error_it_returns_the_integral_and_the_induced_voltage(controller):
    voltage, integral = step(controller, [1.0, 2.0], [-50.0, 80.0], [-50.0, 80.0], 785.0)
    l_d, l_q = controller.inductance
    induced = 785.0 * np.array([-l_q * 80.0, 58e-3 - l_d * 50.0])
    np.testing.assert_allclose(voltage, np.array([1.0, 2.0]) + induced, rtol=1e-12)
    np.testing.assert_allclose(integral, [1.0, 2.0], rtol=1e-12)


def test_a_machine_as_believed_gets_both_poles_at_the_bandwidth(controller):
    rest = step(controller, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 0.0)
    moved = step(controller, [0.0, 0.0], [1.0, 1.0], [0.0, 0.0], 0.0)
    proportional, integral = moved[0] - rest[0], (moved[1] - rest[1]) / 1e-4
    for inductance, k_p, k_i in zip(controller.inductance, proportional, integral, strict=True):
        np.testing.assert_allclose(
            np.poly([-1000.0, -1000.0]), [1.0, k_p / inductance, k_i / inductance], rtol=1e-9
        )


def test_the_limit_shortens_the_vector_and_keeps_its_direction(controller):
    wanted = np.array([600.0, -800.0])
    voltage, _ = step(controller, wanted, [0.0, 0.0], [0.0, 0.0], 0.0)
    np.testing.assert_allclose(voltage, LIMIT * wanted / 1000.0, rtol=1e-12)


def test_the_integral_stops_at_the_limit(controller):
    integral = np.zeros(2)
    for _ in range(300):
        voltage, integral = step(controller, integral, [3000.0, 0.0], [0.0, 0.0], 0.0)
        assert np.hypot(*voltage) <= LIMIT * (1 + 1e-12)
    # Standing still, the rise 0 = e + (u - k_p e - z) / k_p leaves z at the limit itself.
    np.testing.assert_allclose(integral, [LIMIT, 0.0], atol=1e-3)


def test_on_the_hexagon_a_corner_is_reached(controller):
    corner = replace(controller, limit=Hexagon())
    voltage, _ = step(corner, [1000.0, 0.0], [0.0, 0.0], [0.0, 0.0], 0.0)
    np.testing.assert_allclose(voltage, [2 / 3 * 400.0, 0.0], rtol=1e-12)
