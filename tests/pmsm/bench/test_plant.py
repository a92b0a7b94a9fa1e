"""The plant against scipy's integrator, on its own table and on the coenergy itself."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp

from penode.pmsm.bench.machines import TRACTION_300A, torque
from penode.pmsm.bench.plant import plant_of

STEP = 1e-4
START = np.array([-120.0, 150.0])


def speed(rpm):
    return 2 * np.pi / 60 * rpm * TRACTION_300A.pole_pairs


def voltages(omega_el, rows=40):
    """Return steps of +-25 V about a voltage that holds the current roughly, (time, 2)."""
    induced = omega_el * np.array([-0.066, 0.03])
    return induced + np.random.default_rng(4).uniform(-25.0, 25.0, (rows, 2))


def coenergy_derivative(current, voltage, theta, omega_el):
    """Return di/dt from the derivatives of the coenergy, without any table."""

    def flux_linkage(current, theta):
        return jax.grad(lambda i: TRACTION_300A.coenergy(i[0], i[1], theta))(current)

    psi = flux_linkage(current, theta)
    inductance, slope = jax.jacfwd(flux_linkage, argnums=(0, 1))(current, theta)
    rotation = jnp.stack([-psi[1], psi[0]])
    drop = TRACTION_300A.resistance * current
    return jnp.linalg.solve(inductance, voltage - drop - omega_el * (rotation + slope))


def by_scipy(derivative, held, omega_el):
    """Integrate row by row, the voltage held in the rotor frame; return (time + 1, 2)."""
    compiled = jax.jit(derivative)
    currents = [START]
    for k, voltage in enumerate(held):
        solution = solve_ivp(
            lambda t, i, u: compiled(i, u, omega_el * t, omega_el),
            (k * STEP, (k + 1) * STEP),
            currents[-1],
            method="DOP853",
            rtol=1e-11,
            atol=1e-9,
            args=(voltage,),
        )
        currents.append(solution.y[:, -1])
    return np.array(currents)


def by_plant(plant, held, omega_el):
    """Advance the plant through the held voltages; return (time + 1, 2)."""

    def row(current, sample):
        voltage, theta = sample
        end = plant.advance(current, voltage, theta, omega_el)
        return end, end

    theta = omega_el * plant.time_step * np.arange(len(held))
    with jax.enable_x64(True):
        samples = (jnp.asarray(held), jnp.asarray(theta))
        _, ends = jax.jit(lambda start: jax.lax.scan(row, start, samples))(jnp.asarray(START))
        return np.vstack([START, np.asarray(ends)])


@pytest.mark.parametrize("rpm", [1500.0, -4000.0])
def test_integration_error_is_below_1e_8_of_the_current_limit(rpm):
    omega_el = speed(rpm)
    plant = plant_of(TRACTION_300A, time_step=STEP, omega_el=omega_el)
    held = voltages(omega_el)
    with jax.enable_x64(True):
        expected = by_scipy(plant.derivative, held, omega_el)
    assert np.abs(np.diff(expected, axis=0)).max() > 5.0
    np.testing.assert_allclose(by_plant(plant, held, omega_el), expected, atol=3e-6, rtol=0)


def test_plant_follows_the_coenergy_within_the_table_error():
    omega_el = speed(1500.0)
    plant = plant_of(TRACTION_300A, time_step=STEP, omega_el=omega_el)
    held = voltages(omega_el)
    with jax.enable_x64(True):
        expected = by_scipy(coenergy_derivative, held, omega_el)
    found = by_plant(plant, held, omega_el)
    assert np.abs(expected).max() < TRACTION_300A.current_limit
    # A flux error of 1e-10 Vs over an inductance of 120 uH is 1e-6 A; the integration adds its own.
    np.testing.assert_allclose(found, expected, atol=4e-6, rtol=0)


def test_integration_is_of_fourth_order():
    omega_el = speed(1500.0)
    held = voltages(omega_el, rows=10)
    plant = plant_of(TRACTION_300A, time_step=STEP, omega_el=omega_el)
    exact = by_plant(replace(plant, substeps=64), held, omega_el)[-1]
    errors = [
        np.linalg.norm(by_plant(replace(plant, substeps=n), held, omega_el)[-1] - exact)
        for n in (2, 4)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)


def test_energy_is_conserved():
    omega_el, fine = speed(1500.0), 2e-6
    plant = plant_of(TRACTION_300A, time_step=fine, omega_el=omega_el)
    held = np.tile(omega_el * np.array([-0.066, 0.03]) + [6.0, -4.0], (1000, 1))
    current = by_plant(plant, held, omega_el)
    time = fine * np.arange(1001)
    theta = omega_el * time
    supplied = 1.5 * simpson(current @ held[0], x=time)
    heat = 1.5 * TRACTION_300A.resistance * simpson((current**2).sum(axis=1), x=time)
    speed_mechanical = omega_el / TRACTION_300A.pole_pairs
    work = speed_mechanical * simpson(torque(TRACTION_300A, *current.T, theta), x=time)
    stored = np.diff(field_energy(current[[0, -1]], theta[[0, -1]]))[0]
    assert min(abs(heat), abs(work), abs(stored)) > 0.1
    assert supplied == pytest.approx(heat + work + stored, abs=1e-5)


def field_energy(current, theta):
    """Return 3/2 (psi i - W), the energy in the magnetic field up to a constant, in J."""

    def energy(i, theta):
        value, psi = jax.value_and_grad(lambda i: TRACTION_300A.coenergy(i[0], i[1], theta))(i)
        return 1.5 * (psi @ i - value)

    with jax.enable_x64(True):
        return np.asarray(jax.vmap(energy)(jnp.asarray(current), jnp.asarray(theta)))


def test_substeps_grow_with_speed():
    slow = plant_of(TRACTION_300A, time_step=STEP, omega_el=0.0)
    fast = plant_of(TRACTION_300A, time_step=STEP, omega_el=speed(-12000.0))
    assert slow.substeps == 2
    assert fast.substeps == 38
