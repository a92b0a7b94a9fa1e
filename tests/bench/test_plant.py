"""The plant against scipy's integrator, on its own equations and on the coenergy itself."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.integrate import solve_ivp

from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, DeviceDrop, Inverter, Pulses, StationaryHold
from penode.bench.machines import TRACTION_300A
from penode.bench.rig import rig_of, substeps
from penode.bench.sensors import CurrentSensors
from penode.bench.shaft import FreeShaft, Shaft
from penode.bench.winding import IronLoss, Warming, Winding

STEP = 1e-4
START = np.array([-120.0, 150.0])
HELD = Shaft()
LOADED = Shaft(FreeShaft(0.02, load_torque=40.0, friction=0.01), 5.0)
EVERYTHING = Drive(
    inverter=Inverter(StationaryHold(), devices=DeviceDrop(1.0, 1e-3, current_scale=60.0)),
    current_sensors=CurrentSensors(cutoff_hz=2000.0),
    winding=Winding(90.0, (1.0, 1.05, 0.95), Warming(0.5, 0.1)),
    iron_loss=IronLoss(15.0),
    magnet_temperature=100.0,
)


def speed(rpm):
    return 2 * np.pi / 60 * rpm * TRACTION_300A.pole_pairs


def voltages(omega_el, rows, hold=None):
    """Return steps of +-25 V about a voltage that holds the current roughly, (time, 2).

    They are in the frame of the hold, turned ahead by half a sample in the stationary one.
    """
    induced = omega_el * np.array([-0.066, 0.03])
    rotor = induced + np.random.default_rng(4).uniform(-25.0, 25.0, (rows, 2))
    if hold is None or hold.frame == "dq":
        return rotor
    turned = (rotor @ [1, 1j]) * np.exp(1j * omega_el * STEP * (np.arange(rows) + 0.5))
    return np.stack([turned.real, turned.imag], axis=1)


def started(rig, omega_el):
    with jax.enable_x64(True):
        state = rig.plant.rest(jnp.zeros(()), jnp.asarray(omega_el))
        filtered = None if state.filtered is None else jnp.asarray(START)
        return state._replace(current=jnp.asarray(START), filtered=filtered)


def by_scipy(rig, held, omega_el):
    """Integrate all states row by row; return (time + 1, state)."""
    start = started(rig, omega_el)
    with jax.enable_x64(True):
        flat, back = ravel_pytree(start)

        @jax.jit
        def slope(x, vector):
            return ravel_pytree(rig.plant.slope(back(x), rig.voltages(vector), jnp.zeros(())))[0]

        states = [np.asarray(flat)]
        for vector in held:
            solution = solve_ivp(
                lambda t, x, v: slope(x, v),
                (0.0, STEP),
                states[-1],
                method="DOP853",
                rtol=1e-11,
                atol=1e-9,
                args=(vector,),
            )
            states.append(solution.y[:, -1])
    return np.array(states)


def by_plant(rig, held, omega_el):
    """Advance the plant through the held voltages; return (time + 1, state)."""

    def row(state, vector):
        pulses = Pulses(jnp.full(1, STEP), vector[None])
        end = rig.plant.advance(state, pulses, rig.voltages, jnp.zeros(()))
        return end, ravel_pytree(end)[0]

    start = started(rig, omega_el)
    with jax.enable_x64(True):
        _, ends = jax.jit(lambda s, h: jax.lax.scan(row, s, h))(start, jnp.asarray(held))
        return np.vstack([ravel_pytree(start)[0], np.asarray(ends)])


CASES = {
    "ideal": (Drive(), HELD, 1500.0),
    "backwards": (Drive(), HELD, -4000.0),
    "everything": (EVERYTHING, LOADED, 1500.0),
}


@pytest.mark.parametrize("case", CASES)
def test_integration_error_is_below_1e_8_of_the_current_limit(case):
    drive, shaft, rpm = CASES[case]
    rig = rig_of(TRACTION_300A, drive, shaft, speed(rpm))
    held = voltages(speed(rpm), 40, drive.inverter.hold)
    expected = by_scipy(rig, held, speed(rpm))
    assert np.abs(np.diff(expected[:, :2], axis=0)).max() > 5.0
    found = by_plant(rig, held, speed(rpm))
    # Beside the currents in A: angle in rad, speed in rad/s, temperature in degrees.
    np.testing.assert_allclose(found[:, :5], expected[:, :5], atol=3e-6, rtol=0)
    # The filter's output is a measurement; it feeds back only through the controller.
    np.testing.assert_allclose(found[:, 5:], expected[:, 5:], atol=5e-4, rtol=0)


def test_dead_time_costs_accuracy_that_smaller_steps_buy_back():
    """A phase current crosses zero within a few steps: 1e-3 A, and 1e-8 A with 16 times more."""
    drive = Drive(inverter=Inverter(StationaryHold(), dead_time=DeadTime(0.5e-6)))
    rig = rig_of(TRACTION_300A, drive, HELD, speed(1500.0))
    held = voltages(speed(1500.0), 40, drive.inverter.hold)
    expected = by_scipy(rig, held, speed(1500.0))
    finer = replace(rig, plant=replace(rig.plant, substeps=16 * rig.plant.substeps))
    for one, tolerance in ((rig, 5e-3), (finer, 1e-6)):
        found = by_plant(one, held, speed(1500.0))
        assert np.abs(found - expected)[:, :2].max() < tolerance


def coenergy_derivative(current, voltage, theta, omega_el):
    """Return di/dt from the derivatives of the coenergy, without any table."""

    def flux_linkage(current, theta):
        return jax.grad(lambda i: TRACTION_300A.coenergy(i[0], i[1], theta))(current)

    psi = flux_linkage(current, theta)
    inductance, slope = jax.jacfwd(flux_linkage, argnums=(0, 1))(current, theta)
    rotation = jnp.stack([-psi[1], psi[0]])
    drop = TRACTION_300A.resistance * current
    return jnp.linalg.solve(inductance, voltage - drop - omega_el * (rotation + slope))


def test_plant_follows_the_coenergy_within_the_table_error():
    omega_el = speed(1500.0)
    rig = rig_of(TRACTION_300A, Drive(), HELD, omega_el)
    held = voltages(omega_el, rows=40)
    currents = [START]
    with jax.enable_x64(True):
        derivative = jax.jit(coenergy_derivative)
        for k, voltage in enumerate(held):
            solution = solve_ivp(
                lambda t, i, u: derivative(i, u, omega_el * t, omega_el),
                (k * STEP, (k + 1) * STEP),
                currents[-1],
                method="DOP853",
                rtol=1e-11,
                atol=1e-9,
                args=(voltage,),
            )
            currents.append(solution.y[:, -1])
    found = by_plant(rig, held, omega_el)[:, :2]
    assert np.abs(currents).max() < TRACTION_300A.current_limit
    # A flux error of 1e-10 Vs over an inductance of 120 uH is 1e-6 A; the integration adds its own.
    np.testing.assert_allclose(found, currents, atol=4e-6, rtol=0)


def test_integration_is_of_fourth_order():
    omega_el = speed(1500.0)
    held = voltages(omega_el, rows=10)
    rig = rig_of(TRACTION_300A, Drive(), HELD, omega_el)

    def end(steps):
        finer = replace(rig, plant=replace(rig.plant, substeps=steps))
        return by_plant(finer, held, omega_el)[-1, :2]

    exact = end(64)
    errors = [np.linalg.norm(end(n) - exact) for n in (2, 4)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)


def test_substeps_grow_with_speed_filter_and_dead_time():
    assert substeps(TRACTION_300A, Drive(), 0.0) == 2
    assert substeps(TRACTION_300A, Drive(), speed(-12000.0)) == 38
    filtered = Drive(current_sensors=CurrentSensors(cutoff_hz=5000.0))
    assert substeps(TRACTION_300A, filtered, 0.0) == 7
    dead = Drive(inverter=Inverter(dead_time=DeadTime(1e-6, current_scale=1.0)))
    assert substeps(TRACTION_300A, dead, speed(1500.0)) == 12


def slopes(drive, current, theta, omega_el, shaft=HELD):
    """Return the slopes of the currents and of the rest at no terminal voltage."""
    rig = rig_of(TRACTION_300A, drive, shaft, omega_el)
    with jax.enable_x64(True):
        state = rig.plant.rest(jnp.asarray(theta), jnp.asarray(omega_el))
        state = state._replace(current=jnp.asarray(current))
        return rig.plant.slope(state, lambda i, th: jnp.zeros(2), jnp.zeros(())), state, rig


def resistive(drive, theta):
    """Return the matrix from current to resistive voltage at standstill, (2, 2)."""
    columns = []
    for axis in np.eye(2):
        slope, state, rig = slopes(drive, axis, theta, 0.0)
        with jax.enable_x64(True):
            inductance = np.asarray(rig.plant.table(state.current, state.theta_el).inductance)
        columns.append(-inductance @ np.asarray(slope.current))
    return np.array(columns).T


def test_resistance_grows_with_temperature():
    hot = resistive(Drive(winding=Winding(temperature=120.0)), 0.3)
    np.testing.assert_allclose(hot, 10e-3 * (1 + 3.93e-3 * 100) * np.eye(2), atol=1e-12)


def test_unequal_phases_are_a_second_order_in_the_rotor_frame():
    r = 10e-3 * np.array([1.0, 1.06, 0.97])
    for theta in (0.0, 0.4, 1.3):
        found = resistive(Drive(winding=Winding(phase_factors=(1.0, 1.06, 0.97))), theta)
        # 2/3 sum R_k (cos^2, -sin cos; -sin cos, sin^2) at theta - 2 pi k/3, written in 2 theta.
        twice = 2 * (theta - 2 * np.pi / 3 * np.arange(3))
        c, s = (r * np.cos(twice)).mean(), (r * np.sin(twice)).mean()
        np.testing.assert_allclose(found, r.mean() * np.eye(2) + [[c, -s], [-s, -c]], atol=1e-12)


def test_warming_reaches_loss_times_thermal_resistance():
    warming = Warming(heat_capacity=300.0, thermal_resistance=0.05, ambient=60.0)
    loss = 1.5 * 10e-3 * 250.0**2
    drive = Drive(winding=Winding(60.0, warming=warming))
    slope, _, _ = slopes(drive, [-150.0, 200.0], 0.0, 0.0)
    rate = loss * (1 + 3.93e-3 * 40.0) / 300.0
    assert float(slope.temperature) == pytest.approx(rate, rel=1e-12)
    steady = 60.0 + 0.05 * loss
    assert float(warming.rate(steady, loss)) == pytest.approx(0.0, abs=1e-12)


def test_iron_loss_is_the_square_of_the_induced_voltage_over_its_resistance():
    drive = Drive(iron_loss=IronLoss(20.0))
    _, state, rig = slopes(drive, [-100.0, 150.0], 0.2, speed(3000.0))
    with jax.enable_x64(True):
        iron = np.asarray(rig.plant.terminals(state).current - state.current)
        psi = np.asarray(rig.plant.table(state.current, state.theta_el).linkage)
    induced = speed(3000.0) * np.array([-psi[1], psi[0]])
    assert iron @ induced == pytest.approx(speed(3000.0) ** 2 * psi @ psi / 20.0, rel=1e-12)


def test_a_free_shaft_follows_torque_load_and_friction():
    slope, state, rig = slopes(Drive(), [-100.0, 200.0], 0.2, 500.0, shaft=LOADED)
    with jax.enable_x64(True):
        torque = 5.0 * float(rig.plant.torque(state))
    expected = 5.0 * (torque - 40.0 - 0.01 * 100.0) / 0.02
    assert float(slope.omega_el) == pytest.approx(expected, rel=1e-12)
    assert torque > 50.0
