"""What each imperfection leaves in a recording: the closed loop's lines, where theory puts them.

All runs share one compiled program: every record is there, with values that do nothing but one.
The window is 0.04 s at 1500 rpm: one mechanical and 5 electrical turns, so mechanical order m is
line m and electrical order n line 5 n. What counts is the difference to the neutral run.
"""

from dataclasses import replace

import numpy as np
import pytest

from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, DeviceDrop, Inverter
from penode.bench.machines import TRACTION_300A
from penode.bench.run import record, simulate
from penode.bench.sensors import CurrentSensors, Resolver, SpeedSensor
from penode.bench.winding import Winding

ROWS = 400
ORDERS = ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))
NEUTRAL = Drive(
    inverter=Inverter(dead_time=DeadTime(0.0), devices=DeviceDrop(0.0)),
    current_sensors=CurrentSensors(),
    resolver=Resolver(orders=ORDERS),
    speed_sensor=SpeedSensor(orders=ORDERS),
    winding=Winding(phase_factors=(1.0, 1.0, 1.0)),
)
CURRENT = -150.0 + 200.0j
UNIT = CURRENT / abs(CURRENT)


def steady(drive):
    """Return u and i of the last 0.04 s as complex numbers, (2, time)."""

    def reference(time):
        return np.tile([CURRENT.real, CURRENT.imag], (len(time), 1))

    run = simulate(TRACTION_300A, reference, speed_rpm=1500.0, duration=0.2, drive=drive)
    rows = run.stack(["u_d", "u_q", "i_d", "i_q"])[-ROWS:]
    return np.array([rows[:, :2] @ [1, 1j], rows[:, 2:] @ [1, 1j]])


@pytest.fixture(scope="module")
def neutral():
    return steady(NEUTRAL)


def inverter(**changes):
    return replace(NEUTRAL, inverter=replace(NEUTRAL.inverter, **changes))


IMPERFECT = {
    "offset": (
        replace(NEUTRAL, current_sensors=CurrentSensors(offset=(0.9, -0.6, 0.0))),
        [5],
    ),
    "gain": (replace(NEUTRAL, current_sensors=CurrentSensors(gain=(1.0, 1.01, 0.99))), [10]),
    "phase resistance": (replace(NEUTRAL, winding=Winding(phase_factors=(1, 1.1, 0.9))), [10]),
    "dead time": (inverter(dead_time=DeadTime(0.5e-6)), range(30, ROWS // 2, 30)),
    "devices": (inverter(devices=DeviceDrop(1.0, 1e-3)), range(30, ROWS // 2, 30)),
    "resolver order 1": (
        replace(NEUTRAL, resolver=Resolver(orders=((1, 0.005, 0.3), ORDERS[1]))),
        [5],
    ),
    "resolver order 2": (
        replace(NEUTRAL, resolver=Resolver(orders=(ORDERS[0], (2, 0.005, 0.3)), growth=1 / 300)),
        [10],
    ),
    "speed order 1": (
        replace(NEUTRAL, speed_sensor=SpeedSensor(orders=((1, 0.002, 0.0), ORDERS[1]))),
        [1],
    ),
    "speed order 2": (
        replace(NEUTRAL, speed_sensor=SpeedSensor(orders=(ORDERS[0], (2, 0.002, 0.0)))),
        [2],
    ),
}


@pytest.mark.parametrize("name", IMPERFECT)
def test_the_difference_lies_on_the_predicted_lines(neutral, name):
    drive, bins = IMPERFECT[name]
    spectrum = np.fft.fft(steady(drive) - neutral, axis=1) / ROWS
    energy = (np.abs(spectrum) ** 2).sum(axis=0)
    on_lines = sum(energy[n] + energy[-n] for n in bins)
    assert np.sqrt(energy[1:].sum()) > 0.02
    # The rest are products with the slots' lines, second order in the imperfection and the ripple.
    assert on_lines / energy[1:].sum() > 0.98


# The ripple of the currents meets that of the voltages: half a percent beside the square wave's.


def test_dead_time_costs_4_over_pi_of_its_voltage_along_the_current(neutral):
    lost = 400.0 * 0.5e-6 / 1e-4
    found = (steady(inverter(dead_time=DeadTime(0.5e-6, current_scale=1.0))) - neutral)[0].mean()
    assert found == pytest.approx(4 / np.pi * lost * UNIT, rel=5e-3)


def test_devices_cost_their_threshold_and_resistance_along_the_current(neutral):
    found = (steady(inverter(devices=DeviceDrop(1.0, 2e-3, current_scale=1.0))) - neutral)[0].mean()
    assert found == pytest.approx((4 / np.pi + 2e-3 * abs(CURRENT)) * UNIT, rel=5e-3)


def test_the_mean_of_unequal_phases_is_what_the_voltage_shows(neutral):
    drive = replace(NEUTRAL, winding=Winding(phase_factors=(1.3, 1.2, 1.1)))
    found = (steady(drive) - neutral)[0].mean()
    assert found == pytest.approx(0.2 * 10e-3 * CURRENT, rel=2e-2)


def test_a_static_angle_error_shows_as_a_wrong_resistance(neutral):
    """Measured current held, the true one is turned on by delta, the voltage seen turned back."""
    delta = 0.01
    drive = replace(NEUTRAL, resolver=Resolver(offset=delta, orders=ORDERS))
    made = record(
        TRACTION_300A,
        lambda time: np.tile([CURRENT.real, CURRENT.imag], (len(time), 1)),
        speed_rpm=1500.0,
        duration=0.2,
        drive=drive,
    )
    true = (made.truth.trace.current[-ROWS:] @ [1, 1j]).mean()
    assert true == pytest.approx(CURRENT * np.exp(1j * delta), rel=1e-6)
    angle = made.experiment.channels["theta_el"] - np.mod(made.truth.trace.theta_el, 2 * np.pi)
    np.testing.assert_allclose(np.mod(angle, 2 * np.pi), delta, atol=1e-9)
