"""The inverter's blocks against closed forms: hold, dead time, limits, pulse-width modulation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.bench.drive import Drive
from penode.bench.inverter import (
    CarrierPwm,
    Circle,
    DeadTime,
    DeviceDrop,
    Hexagon,
    Inverter,
    RotorHold,
    StationaryHold,
    Switching,
)
from penode.bench.machines import TRACTION_300A
from penode.bench.rig import rig_of
from penode.bench.shaft import Shaft

LINK = Switching(400.0, 1e-4)
TURN = np.linspace(0.0, 2 * np.pi, 7200, endpoint=False)
LOSS = 400.0 * 1e-6 / 1e-4


def over_turn(inverter, vector, current):
    """Return the terminal voltage over one electrical turn as complex numbers, (angle,)."""
    with jax.enable_x64(True):
        both = jax.vmap(
            lambda th: inverter.terminal_voltage(
                jnp.asarray(vector), jnp.asarray(current), th, LINK
            )
        )(jnp.asarray(TURN))
        return np.asarray(both) @ [1, 1j]


def test_the_ideal_inverter_gives_what_is_asked_for():
    np.testing.assert_array_equal(over_turn(Inverter(), [20.0, 50.0], [9.0, 9.0]), 20 + 50j)


def test_a_stationary_hold_shortens_and_turns_the_mean_by_half_a_sample():
    turn = 0.4
    hold = StationaryHold()
    with jax.enable_x64(True):
        angles = turn * (jnp.arange(4000) + 0.5) / 4000
        seen = jax.vmap(
            lambda th: Inverter(hold).terminal_voltage(
                jnp.array([30.0, 40.0]), jnp.zeros(2), th, LINK
            )
        )(angles)
    mean = (np.asarray(seen) @ [1, 1j]).mean()
    sinc = np.sin(turn / 2) / (turn / 2)
    assert mean == pytest.approx((30 + 40j) * sinc * np.exp(-0.5j * turn), rel=1e-7)
    assert [hold.mean_lag(0), hold.mean_lag(1), StationaryHold(1.5).mean_lag(1)] == [0.5, 1.5, 0]


def test_dead_time_is_4_over_pi_of_its_voltage_and_lines_at_multiples_of_six():
    current = 200.0 * np.exp(2.1j)
    inverter = Inverter(dead_time=DeadTime(1e-6, current_scale=0.01))
    lost = 10.0 - over_turn(inverter, [10.0, 0.0], [current.real, current.imag])
    lines = np.fft.fft(lost / np.exp(2.1j)) / len(TURN)
    assert lines[0] == pytest.approx(4 / np.pi * LOSS, rel=1e-4)
    # A square wave's harmonic 6k -+ 1 of size 4/pi dU/(6k -+ 1) lies at -+6k in the rotor frame.
    for k in (1, 2, 3):
        for order in (6 * k, -6 * k):
            size = 4 / np.pi * LOSS / abs(order + 1)
            assert abs(lines[order]) == pytest.approx(size, rel=1e-3)
    others = np.delete(np.arange(len(TURN)), np.arange(0, len(TURN), 6))
    assert np.abs(lines[others]).max() < 1e-3 * LOSS


def test_a_smooth_crossing_takes_less():
    """Where the current is far below the scale, the loss is dU i / i_0."""
    inverter = Inverter(dead_time=DeadTime(1e-6, current_scale=2.0))
    lost = -over_turn(inverter, [0.0, 0.0], [0.02, 0.01])
    np.testing.assert_allclose(lost, LOSS * (0.02 + 0.01j) / 2.0, rtol=1e-4)


def test_devices_lose_a_threshold_and_a_resistance():
    inverter = Inverter(devices=DeviceDrop(1.2, 2e-3, current_scale=0.01))
    lost = -over_turn(inverter, [0.0, 0.0], [-30.0, 40.0])
    mean = 4 / np.pi * 1.2 * (-30 + 40j) / 50 + 2e-3 * (-30 + 40j)
    assert lost.mean() == pytest.approx(mean, rel=1e-4)


def test_a_soft_knee_loses_an_arctangent_of_each_phase():
    """Small currents meet the slope 2 u_0 / (pi i_0), large ones the square wave's fundamental."""
    inverter = Inverter(devices=DeviceDrop(1.2, current_scale=2.0, soft=True))
    lost = -over_turn(inverter, [0.0, 0.0], [0.02, 0.01])
    np.testing.assert_allclose(lost, 1.2 * 2 / np.pi * (0.02 + 0.01j) / 2.0, rtol=1e-4)
    lost = -over_turn(inverter, [0.0, 0.0], [3e4, 4e4])
    assert lost.mean() == pytest.approx(4 / np.pi * 1.2 * (0.6 + 0.8j), rel=1e-3)


def test_phases_with_other_thresholds_lose_other_voltages():
    """Their mean acts along the current; what differs turns twice against the rotor."""
    factors = (1.3, 0.9, 0.8)
    inverter = Inverter(devices=DeviceDrop(1.2, current_scale=0.01, phase_factors=factors))
    lost = -over_turn(inverter, [0.0, 0.0], [50.0, 0.0])
    assert lost.mean() == pytest.approx(4 / np.pi * 1.2 * np.mean(factors), rel=1e-4)
    lines = np.fft.fft(lost) / len(TURN)
    unbalance = abs(sum(f * np.exp(2j * np.pi * k / 3) for k, f in enumerate(factors))) / 3
    assert abs(lines[-2]) == pytest.approx(4 / np.pi * 1.2 * unbalance, rel=1e-3)


def used(limit, voltage, theta):
    with jax.enable_x64(True):
        return float(limit.used(jnp.asarray(voltage), jnp.asarray(theta), 400.0))


def test_the_circle_touches_the_hexagon_between_its_corners():
    inner = 400.0 / np.sqrt(3.0)
    assert used(Circle(), [0.0, inner], 1.0) == pytest.approx(1.0)
    # The middle of a side lies at 30 degrees from phase a, a corner of length 2/3 u_dc at 0.
    assert used(Hexagon(), [inner, 0.0], np.pi / 6) == pytest.approx(1.0)
    assert used(Hexagon(), [2 / 3 * 400.0, 0.0], 0.0) == pytest.approx(1.0)
    assert used(Hexagon(), [2 / 3 * 400.0, 0.0], np.pi / 3) == pytest.approx(1.0)


def test_the_hexagon_is_the_largest_line_to_line_voltage(rng):
    for theta, *voltage in rng.uniform(-4.0, 4.0, (20, 3)):
        phase = theta - 2 * np.pi / 3 * np.arange(3)
        by_phase = voltage[0] * np.cos(phase) - voltage[1] * np.sin(phase)
        largest = max(abs(one - other) for one in by_phase for other in by_phase)
        assert used(Hexagon(), voltage, theta) == pytest.approx(largest / 400.0)


@pytest.mark.parametrize("kind", [StationaryHold, CarrierPwm])
@pytest.mark.parametrize(("advance", "delay"), [(0.0, 0), (0.5, 0), (1.5, 1), (0.3, 2)])
def test_the_mean_of_what_is_sent_lags_by_what_the_hold_says(kind, advance, delay):
    """Sent at an angle of 0.4 rad, held for one interval that begins `delay` samples later."""
    hold, turn = kind(advance), 0.1
    sent = float(hold.command_angle(jnp.asarray(0.4), jnp.asarray(turn)))
    rotor = 0.4 + turn * (delay + (np.arange(1000) + 0.5) / 1000)
    frame = np.array([float(hold.frame_angle(jnp.asarray(one))) for one in rotor[::500]])
    np.testing.assert_array_equal(frame, 0.0)
    mean = np.exp(1j * (sent - rotor)).mean()
    assert np.angle(mean) == pytest.approx(-hold.mean_lag(delay) * turn, abs=1e-6)


def test_pulses_reach_the_circle_at_every_angle():
    """Without the shift that centres the phases, a leg would have to go beyond its rail."""
    wanted = 0.999 * 400.0 / np.sqrt(3.0) * np.exp(1j * TURN[::24])
    with jax.enable_x64(True):
        durations, legs = jax.vmap(lambda v: CarrierPwm().pulses(v, jnp.zeros(3), None, LINK))(
            jnp.stack([wanted.real, wanted.imag], axis=1)
        )
    mean = (np.asarray(durations)[..., None] * np.asarray(legs)).sum(axis=1) / 1e-4
    np.testing.assert_allclose(mean @ [1, 1j], wanted, atol=1e-9)


@pytest.mark.parametrize("dead_time", [None, DeadTime(1.5e-6, current_scale=5.0)])
def test_the_mean_over_a_switching_period_is_the_averaged_model(dead_time):
    random = np.random.default_rng(5)
    vectors = random.uniform(-140.0, 140.0, (300, 2))
    current = random.uniform(-20.0, 20.0, (300, 2)) @ np.array([[1, -0.5, -0.5], [0, 0.9, -0.9]])
    with jax.enable_x64(True):
        durations, legs = jax.vmap(lambda v, i: CarrierPwm().pulses(v, i, dead_time, LINK))(
            jnp.asarray(vectors), jnp.asarray(current)
        )
        lost = np.zeros((300, 3))
        if dead_time is not None:
            lost = np.asarray(StationaryHold().dead_time_loss(dead_time, current, LINK))
    durations = np.asarray(durations)
    np.testing.assert_allclose(durations.sum(axis=1), 1e-4, rtol=1e-12)
    assert durations.min() >= 0.0
    mean = (durations[..., None] * np.asarray(legs)).sum(axis=1) / 1e-4
    clarke = 2 / 3 * np.array([[1, -0.5, -0.5], [0, 3**0.5 / 2, -(3**0.5) / 2]])
    np.testing.assert_allclose(mean, vectors - lost @ clarke.T, atol=1e-9)


def test_a_machine_on_pulses_samples_the_currents_of_the_averaged_model():
    """At the ends of the period the ripple crosses zero, so both agree far better than it is."""
    omega_el = 2 * np.pi * 25.0 * 5
    vectors = 60.0 * np.exp(1j * (omega_el * 1e-4 * (np.arange(25) + 0.5) + 1.3))
    held = np.stack([vectors.real, vectors.imag], axis=1)
    ends, inside = {}, 0.0
    for hold in (StationaryHold(), CarrierPwm()):
        rig = rig_of(TRACTION_300A, Drive(inverter=Inverter(hold)), Shaft(), omega_el)

        def interval(state, vector, rig=rig):
            pulses = rig.inverter.hold.pulses(vector, jnp.zeros(3), None, rig.switching)
            half = pulses._replace(durations=jnp.cumsum(pulses.durations)[:1])
            ripple = rig.plant.advance(
                state, half._replace(vectors=pulses.vectors[:1]), rig.voltages, jnp.zeros(())
            )
            end = rig.plant.advance(state, pulses, rig.voltages, jnp.zeros(()))
            return end, (end.current, ripple.current)

        with jax.enable_x64(True):
            start = rig.plant.rest(jnp.zeros(()), jnp.asarray(omega_el))
            _, rows = jax.jit(lambda s, h, f=interval: jax.lax.scan(f, s, h))(
                start, jnp.asarray(held)
            )
        ends[type(hold)] = np.asarray(rows[0])
        inside = np.abs(np.diff(np.asarray(rows[1]) - np.asarray(rows[0]), axis=0)).max()
    difference = np.abs(ends[StationaryHold] - ends[CarrierPwm]).max()
    assert inside > 1.0
    assert difference < 0.02


def test_the_ideal_hold_has_no_lag():
    assert RotorHold().mean_lag(1) == 0.0


def test_programs_of_unlike_inverters_are_kept_apart():
    """Structures of like fields must differ, or compiled programs are mixed up."""
    structures = {
        jax.tree.structure(Inverter(hold, limit))
        for hold in (RotorHold(), StationaryHold(), CarrierPwm())
        for limit in (Circle(), Hexagon())
    }
    assert len(structures) == 6
    known = list(structures)
    assert not any(a == b for i, a in enumerate(known) for b in known[:i])
