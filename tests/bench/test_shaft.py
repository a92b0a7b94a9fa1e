"""The shaft: given motions against integrals in closed form, and a free one in the same units."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.bench.shaft import (
    FreeShaft,
    SpeedPoints,
    SpeedRipple,
    shaft_of,
)

STEP, PAIRS = 1e-3, 4
INSTANTS = STEP * np.arange(401)


def turned(motion, angle):
    """Compare an electrical angle with one that is counted on, whole mechanical turns aside."""
    mechanical = np.exp(1j * np.asarray(motion.theta_el) / PAIRS)
    np.testing.assert_allclose(mechanical, np.exp(1j * angle / PAIRS), atol=1e-10)


def test_the_angle_of_a_ramp_is_its_parabola():
    _, motion = shaft_of(SpeedPoints((0.0, 0.4), (-300.0, 900.0)), INSTANTS, STEP, PAIRS)
    start, rate = np.array([-300.0, 3000.0]) * 2 * np.pi / 60 * PAIRS
    time = INSTANTS[:-1]
    turned(motion, start * time + rate * time**2 / 2)
    np.testing.assert_allclose(motion.omega_el, start + rate * time, atol=1e-9)
    np.testing.assert_allclose(motion.slope, rate, rtol=1e-9)


def test_points_are_joined_straight_and_kept_beyond():
    speed = SpeedPoints((1.0, 2.0, 4.0), (100.0, -100.0, 500.0))
    np.testing.assert_allclose(speed(np.array([0.0, 1.5, 3.0, 9.0])), [100.0, 0.0, 200.0, 500.0])


def test_a_ripple_has_its_size_and_phase_at_its_mechanical_order():
    """Over one mechanical turn the line m of the speed is n_0 a_m exp(j phi_m) / 2."""
    ripple = SpeedRipple(600.0, ((1, 0.01, 0.7), (3, 0.004, -2.0)))
    lines = np.fft.rfft(ripple(np.linspace(0.0, 0.1, 64, endpoint=False))) / 64
    expected = np.zeros(33, dtype=complex)
    expected[[0, 1, 3]] = 600.0, 3.0 * np.exp(0.7j), 1.2 * np.exp(-2.0j)
    np.testing.assert_allclose(lines, expected, atol=1e-12)


@pytest.mark.parametrize("speed", [900.0, SpeedPoints((0.0,), (900.0,))])
def test_an_angle_starts_anew_after_a_whole_mechanical_turn(speed):
    """A speed sensor's waves are of mechanical orders: the angle must tell the pole pairs apart."""
    shaft, motion = shaft_of(speed, INSTANTS, STEP, PAIRS)
    assert shaft.free is None
    turned(motion, 2 * np.pi * 15.0 * PAIRS * INSTANTS[:-1])
    assert motion.theta_el.min() >= 0.0
    assert 2 * np.pi * (PAIRS - 0.5) < motion.theta_el.max() < 2 * np.pi * PAIRS


def test_a_free_shaft_starts_at_its_speed_and_keeps_its_mechanical_turn():
    shaft, motion = shaft_of(FreeShaft(0.02, start_rpm=-300.0), INSTANTS, STEP, PAIRS)
    assert shaft.free is not None
    assert motion.omega_el[0] == pytest.approx(-10 * np.pi * PAIRS)
    with jax.enable_x64(True):
        moved = jnp.asarray(2 * np.pi * PAIRS + 7.0), jnp.asarray(55.0)
        theta, omega = shaft.at_sample(moved, motion)
    assert float(theta) == pytest.approx(7.0)
    assert float(omega) == 55.0


def test_load_and_friction_slow_a_shaft_whichever_way_it_turns():
    """A load torque is positive against forward rotation; friction is against any."""
    rubbing, loaded = FreeShaft(0.5, friction=0.2), FreeShaft(0.5, load_torque=3.0)
    nothing = jnp.zeros(())
    for speed in (-20.0, 20.0):
        assert float(rubbing.acceleration(nothing, speed)) == pytest.approx(-0.4 * speed)
        assert float(loaded.acceleration(nothing, speed)) == pytest.approx(-6.0)
