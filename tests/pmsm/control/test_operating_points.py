"""Currents over torque and speed: closed forms without saturation, least length with it."""

from dataclasses import replace

import numpy as np
import pytest

from penode.errors import InputError
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.loci import base_speed, control_loci, most_torque_over_speed
from penode.pmsm.control.operating_points import operating_points

#: Without saturation: H, H, Vs, pole pairs; limits in A and V.
L_D, L_Q, PSI, PAIRS = 2e-4, 5e-4, 0.06, 4
AMPS, VOLTS = 400.0, 200.0
SALIENCY = L_Q - L_D


def flux_map(i_d, i_q):
    return np.stack(np.broadcast_arrays(PSI + L_D * np.asarray(i_d), L_Q * np.asarray(i_q)))


def inductance(i_d, i_q):
    one = np.ones(np.broadcast_shapes(np.shape(i_d), np.shape(i_q)))
    return np.stack([np.stack([L_D * one, 0 * one]), np.stack([0 * one, L_Q * one])])


LINEAR = ControlledMachine(flux_map, inductance, PAIRS, 0.01)


def torque_of(i_d, i_q):
    return 1.5 * PAIRS * (PSI - SALIENCY * i_d) * i_q


def speed_at(i_d, i_q, sign):
    """Return the mechanical speed, rad/s, at which the voltage of a current is at its limit."""
    u_flux = np.hypot(PSI + L_D * i_d, L_Q * i_q)
    # |R i + omega J psi|^2 = U^2, where i . J psi is the torque over 3/2 p.
    along = 0.01 * torque_of(i_d, i_q) / (1.5 * PAIRS)
    rest = (VOLTS**2 - 0.01**2 * (i_d**2 + i_q**2)) * u_flux**2
    return (sign * np.sqrt(along**2 + rest) - along) / u_flux**2 / PAIRS


def mtpa_i_d(length):
    return (PSI - np.sqrt(PSI**2 + 8 * (SALIENCY * length) ** 2)) / (4 * SALIENCY)


def test_at_low_speed_the_torque_is_inverted_on_the_closed_form_of_mtpa():
    length = np.linspace(0, AMPS, 9)
    i_d = mtpa_i_d(length)
    i_q = np.sqrt(length**2 - i_d**2)
    points = operating_points(LINEAR, torque_of(i_d, i_q), np.array([0.0, 100.0]), AMPS, VOLTS)
    for column in range(2):
        np.testing.assert_allclose(
            points.current[..., column], [i_d, i_q], rtol=1e-6, atol=1e-6 * AMPS
        )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("brake", [1, -1])
def test_field_weakening_is_the_closed_form(sign, brake):
    """Every current between MTPA and MTPV is the answer for its torque and its speed."""
    for length in (100.0, 200.0, 290.0):
        for share in (0.15, 0.6, 0.95):
            i_d = mtpa_i_d(length) + share * (-0.8 * length - mtpa_i_d(length))
            i_q = brake * np.sqrt(length**2 - i_d**2)
            speed = speed_at(i_d, i_q, sign)
            found = operating_points(LINEAR, torque_of(i_d, i_q), speed, AMPS, VOLTS)
            np.testing.assert_allclose(found.current[:, 0, 0], [i_d, i_q], rtol=1e-6)
            assert found.voltage[0, 0] == pytest.approx(VOLTS, rel=1e-9)


def test_of_a_saturated_machine_no_shorter_current_gives_the_torque(machine_fit):
    machine = ControlledMachine.of(machine_fit)
    base = base_speed(machine, 240.0, 120.0)
    torque, speed = np.array([0.0, 30.0, 70.0]), base * np.array([0.3, 1.3, 2.6])
    points = operating_points(machine, torque, speed, 240.0, 120.0)
    radius, angle = np.meshgrid(np.linspace(0, 240, 241), np.linspace(0, np.pi, 721))
    tried = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    made = machine.torque(tried)
    assert points.reached[:, 0].all()
    assert np.count_nonzero(points.reached) >= 7
    for column, at in enumerate(speed * machine.pole_pairs):
        volts = np.hypot(*machine.voltage(tried, at))
        for row, wanted in enumerate(torque):
            enough = (volts <= 120.0) & (made >= wanted)
            if not points.reached[row, column]:
                assert not enough.any()
                continue
            current = points.current[:, [row], column]
            assert machine.torque(current)[0] == pytest.approx(wanted, abs=1e-8)
            assert points.voltage[row, column] <= 120.0 * (1 + 1e-8)
            shortest = radius[enough].min()
            assert np.hypot(*current)[0] <= shortest + 1e-9
            assert np.hypot(*current)[0] >= shortest - 1.5


def test_what_is_reached_ends_at_the_most_torque_over_speed():
    speed = base_speed(LINEAR, AMPS, VOLTS) * np.array([0.5, 1.2, 2.0, 3.5])
    most = most_torque_over_speed(LINEAR, speed, AMPS, VOLTS)
    for k, end in enumerate(most.torque):
        share = np.array([0.9, 0.999, 0.999999, 1.000001, 1.01])
        points = operating_points(LINEAR, share * end, speed[[k]], AMPS, VOLTS)
        np.testing.assert_array_equal(points.reached[:, 0], share < 1)
        np.testing.assert_allclose(points.current[:, 2, 0], most.current[:, k], rtol=5e-3, atol=1)


def test_the_table_leaves_what_is_out_of_reach_empty(machine_fit):
    inner = replace(machine_fit, excited=machine_fit.excited / 3)
    machine = ControlledMachine.of(inner)
    most = float(control_loci(machine, 240.0, points=4).mtpa.torque[-1])
    points = operating_points(machine, [-10.0, 0.9 * most, 1.1 * most], [0.0, 50.0], 240.0)
    lines = [line.split(",") for line in points.csv().splitlines()]
    assert lines[0] == [
        "torque",
        "speed_rpm",
        "i_d",
        "i_q",
        "psi_d",
        "psi_q",
        "voltage",
        "supported",
    ]
    assert len(lines) == 7
    assert [row[-1] for row in lines[1:]] == ["1", "1", "0", "0", "0", "0"]
    assert all(cell == "" for row in lines[5:] for cell in row[2:7])
    assert float(lines[2][1]) == pytest.approx(50 * 30 / np.pi)
    assert float(lines[1][3]) < 0
    psi = machine.flux_map(*map(float, lines[3][2:4]))
    np.testing.assert_allclose(np.array(lines[3][4:6], dtype=float), psi, rtol=1e-6)


def test_refusals():
    with pytest.raises(InputError, match="current limit must be > 0, got 0"):
        operating_points(LINEAR, [1.0], [1.0], 0.0)
    with pytest.raises(InputError, match="torque must be finite, got inf"):
        operating_points(LINEAR, [np.inf], [1.0], 10.0)
