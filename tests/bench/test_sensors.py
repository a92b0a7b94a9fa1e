"""The sensors against closed forms: order, size, variance and bandwidth of what they add."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import jv

from penode.bench.sensors import (
    CurrentSensors,
    Draws,
    Quantisation,
    Resolver,
    Sensors,
    SpeedSensor,
    Terminals,
)

TURN = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
CURRENT = np.array([-120.0, 160.0])


def read(current=None, resolver=None, speed=None, *, dq=CURRENT, angles=TURN, pole_pairs=1.0):
    """Return the readings over the angles, the noise drawn from one seed."""
    sensors = Sensors(current, resolver, speed, 0.0, pole_pairs)
    random = np.random.default_rng(8)
    n = len(angles)
    with jax.enable_x64(True):
        draws = Draws(
            jnp.zeros((n, 2)),
            jnp.asarray(random.standard_normal((n, 3))),
            jnp.asarray(random.standard_normal(n)),
        )

        def one(angle, draw):
            truth = Terminals(jnp.asarray(dq), None, angle, jnp.asarray(500.0))
            return sensors.read(truth, draw)

        reading = jax.vmap(one)(jnp.asarray(angles), draws)
    return jax.tree.map(np.asarray, reading)


def lines(reading):
    """Return the complex lines of the dq current over one electrical turn, by order."""
    return np.fft.fft(reading.current @ [1, 1j]) / len(reading.current)


def check_lines(found, expected, atol=1e-9):
    """Compare the lines, all others being zero."""
    wanted = np.zeros(len(found), dtype=complex)
    for order, value in expected.items():
        wanted[order] += value
    np.testing.assert_allclose(found, wanted, atol=atol)


def test_without_sensors_the_truth_is_read():
    reading = read()
    np.testing.assert_array_equal(reading.current, np.tile(CURRENT, (720, 1)))
    np.testing.assert_array_equal(reading.theta_el, TURN)
    np.testing.assert_array_equal(reading.omega_el, 500.0)


def test_a_current_offset_is_of_order_one():
    offset = np.array([0.9, -0.6, 0.3])
    a = np.exp(2j * np.pi / 3)
    vector = 2 / 3 * offset @ [1, a, a**2]
    found = lines(read(CurrentSensors(offset=tuple(offset))))
    check_lines(found, {0: CURRENT @ [1, 1j], -1: vector})
    assert abs(vector) > 0.5


def test_a_gain_error_is_of_order_two():
    gain = np.array([1.0, 1.01, 0.985])
    a = np.exp(2j * np.pi / 3)
    i = CURRENT @ [1, 1j]
    # 2/3 sum g_k Re(i e^{j(theta - 2 pi k/3)}) e^{-j(theta - 2 pi k/3)}, split into its two terms.
    found = lines(read(CurrentSensors(gain=tuple(gain))))
    check_lines(found, {0: gain.mean() * i, -2: np.conj(i) * (gain @ [1, a**2, a**4]) / 3})
    assert abs(found[-2]) > 0.5


def test_quantisation_adds_a_twelfth_of_the_squared_step():
    adc = Quantisation(full_scale=400.0, bits=12)
    assert adc.step == 800.0 / 4096
    current = np.random.default_rng(1).uniform(-300.0, 300.0, 200_000)
    with jax.enable_x64(True):
        error = np.asarray(adc.rounded(jnp.asarray(current))) - current
        clipped = np.asarray(adc.rounded(jnp.array([-500.0, 500.0])))
    assert error.var() == pytest.approx(adc.step**2 / 12, rel=0.02)
    assert np.abs(error).max() <= adc.step / 2 * (1 + 1e-9)
    np.testing.assert_allclose(clipped, [-400.0, 400.0 - adc.step])


def test_phase_noise_reaches_both_axes_with_two_thirds_of_its_variance():
    angles = np.linspace(0.0, 40 * np.pi, 60_000, endpoint=False)
    noise = read(CurrentSensors(noise=0.4), angles=angles).current - CURRENT
    np.testing.assert_allclose(noise.var(axis=0), 2 / 3 * 0.4**2, rtol=0.03)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 0.02


def test_the_filter_passes_1_over_sqrt_2_at_its_cutoff_of_the_phase_frequency():
    sensors = CurrentSensors(cutoff_hz=700.0)
    omega = 2 * np.pi * 700.0
    i = CURRENT @ [1, 1j]
    y = i / (1 + 1j)
    assert abs(y) == pytest.approx(abs(i) / np.sqrt(2))
    with jax.enable_x64(True):
        rate = sensors.filter_rate(jnp.array([y.real, y.imag]), jnp.asarray(CURRENT), omega)
    np.testing.assert_allclose(rate, 0.0, atol=1e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_a_resolver_order_is_that_order_in_the_currents(order):
    """exp(-j a sin n theta) has the Bessel function J_m(a) at the order -m n."""
    size = 0.02
    found = lines(read(resolver=Resolver(orders=((order, size, 0.0),))))
    i = CURRENT @ [1, 1j]
    check_lines(found, {-m * order: jv(m, size) * i for m in range(-4, 5)}, atol=1e-8)
    assert abs(found[order]) == pytest.approx(0.01 * abs(i), rel=1e-3)


def test_a_resolver_order_n_moves_a_line_k_to_k_minus_and_plus_n():
    """The offset's line at -1 appears at -1 -+ 2 too, of half the product of both sizes."""
    sensors = CurrentSensors(offset=(0.9, -0.45, -0.45))
    found = lines(read(sensors, Resolver(orders=((2, 0.02, 0.0),)), dq=np.zeros(2)))
    check_lines(found, {-1 - 2 * m: 0.9 * jv(m, 0.02) for m in range(-3, 4)}, atol=1e-8)


def test_the_resolver_error_grows_with_current():
    resolver = Resolver(offset=0.003, orders=((1, 0.005, 0.4),), growth=1 / 400.0)
    small = read(resolver=resolver, dq=np.zeros(2)).theta_el - TURN
    large = read(resolver=resolver).theta_el - TURN
    np.testing.assert_allclose(small, 0.003 + 0.005 * np.sin(TURN + 0.4), atol=1e-14)
    np.testing.assert_allclose(large, 0.003 + 0.0075 * np.sin(TURN + 0.4), atol=1e-14)


def test_a_static_angle_offset_turns_the_current():
    reading = read(resolver=Resolver(offset=0.01))
    np.testing.assert_allclose(
        reading.current @ [1, 1j], (CURRENT @ [1, 1j]) * np.exp(-0.01j), rtol=1e-12
    )


def test_speed_waves_are_of_mechanical_orders():
    """Over one mechanical turn, which is five electrical ones, order m is line m."""
    angles = np.linspace(0.0, 10 * np.pi, 720, endpoint=False)
    sensor = SpeedSensor(orders=((1, 0.004, 0.0), (2, 0.002, 0.5)))
    reading = read(speed=sensor, angles=angles, pole_pairs=5.0)
    found = np.abs(np.fft.rfft(reading.omega_el)) / 360
    np.testing.assert_allclose(found[1:6], [2.0, 1.0, 0, 0, 0], atol=1e-9)


def test_speed_noise_is_a_share_of_the_speed():
    angles = np.zeros(50_000)
    speed = read(speed=SpeedSensor(noise=0.003), angles=angles).omega_el
    assert speed.std() == pytest.approx(1.5, rel=0.02)
    assert speed.mean() == pytest.approx(500.0, abs=0.03)
