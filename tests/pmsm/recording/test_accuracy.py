"""Imperfections of a recording chain, each against what it does to three phases."""

import numpy as np
import pytest

from penode import Experiment, InputError
from penode.pmsm import abc_from_dq, dq_from_abc
from penode.pmsm.recording.accuracy import Accuracy

STEP, SPEED = 1e-4, 700.0
SIZES = Accuracy(0.01, 0.02, 0.004, 0.003, 0.001, 2.0, 0.25)


@pytest.fixture
def run():
    time = STEP * np.arange(400)
    channels = {
        "i_d": -40 + 20 * np.sin(90 * time),
        "i_q": 60 * np.cos(70 * time),
        "u_d": 5 + 30 * np.sin(50 * time),
        "u_q": 90 + 10 * np.cos(40 * time),
        "omega_el": np.full(400, SPEED),
        "theta_el": 0.3 + SPEED * time,
    }
    return Experiment("run.csv", STEP, channels)


def changed(run, source, deviations=1.0):
    every = [one for one in SIZES.imperfections([run]) if one.source == source]
    return [one.applied(run, deviations) for one in every]


def dq(run, letter):
    return run.stack((f"{letter}_d", f"{letter}_q"))


@pytest.mark.parametrize(
    ("source", "names", "factor"),
    [
        ("gain of the currents", ("i_d", "i_q"), 1.03),
        ("gain of the voltages", ("u_d", "u_q"), 1.06),
        ("gain of the speed", ("omega_el",), 1.003),
    ],
)
def test_gains_scale_their_channels_alone(run, source, names, factor):
    (other,) = changed(run, source, 3.0)
    for name, values in run.channels.items():
        expected = values * (factor if name in names else 1.0)
        np.testing.assert_allclose(other.channels[name], expected, rtol=1e-12)


def test_an_angle_turns_currents_voltages_and_itself(run):
    (other,) = changed(run, "angle of the d axis")
    late = run.channels["theta_el"] + np.deg2rad(2.0)
    for letter in "iu":
        phases = abc_from_dq(dq(run, letter), run.channels["theta_el"])
        np.testing.assert_allclose(dq(other, letter), dq_from_abc(phases, late), atol=1e-9)
    np.testing.assert_allclose(other.channels["theta_el"], late)


def test_a_delay_mixes_each_voltage_with_the_one_before(run):
    (other,) = changed(run, "delay of the voltage")
    before = dq(run, "u")
    np.testing.assert_allclose(dq(other, "u")[1:], 0.75 * before[1:] + 0.25 * before[:-1])
    np.testing.assert_array_equal(dq(other, "u")[0], before[0])
    np.testing.assert_array_equal(dq(other, "i"), dq(run, "i"))


def test_offsets_are_constant_in_the_phases(run):
    largest = np.hypot(*dq(run, "i").T).max()
    for other, axis in zip(changed(run, "offset of the currents"), (0.0, np.pi / 2), strict=True):
        error = abc_from_dq(dq(other, "i") - dq(run, "i"), run.channels["theta_el"])
        expected = 0.003 * largest * np.cos(axis - np.array([0, 2, -2]) * np.pi / 3)
        np.testing.assert_allclose(error, np.broadcast_to(expected, error.shape), atol=1e-12)


def test_one_of_the_mismatches_is_that_of_phase_a_against_the_others(run):
    """The stationary axis of phase a gains what the one across it loses."""
    other, across = changed(run, "gains of the phases among each other")
    turned = np.exp(1j * run.channels["theta_el"])
    stationary = (run.channels["i_d"] + 1j * run.channels["i_q"]) * turned
    expected = 1.004 * stationary.real + 0.996j * stationary.imag
    got = (other.channels["i_d"] + 1j * other.channels["i_q"]) * turned
    np.testing.assert_allclose(got, expected, atol=1e-10)
    mixed = (across.channels["i_d"] + 1j * across.channels["i_q"]) * turned
    expected = stationary + 0.004 * (stationary.imag + 1j * stationary.real)
    np.testing.assert_allclose(mixed, expected, atol=1e-10)


def test_none_of_no_deviation_changes_anything(run):
    for one in SIZES.imperfections([run]):
        other = one.applied(run, 0.0)
        for name, values in run.channels.items():
            np.testing.assert_allclose(other.channels[name], values, atol=1e-12)


def test_phases_need_the_angle(run):
    channels = {name: v for name, v in run.channels.items() if name != "theta_el"}
    blind = Experiment("run.csv", STEP, channels)
    sources = {one.source for one in SIZES.imperfections([blind])}
    assert sources == {
        "gain of the currents",
        "gain of the voltages",
        "gain of the speed",
        "angle of the d axis",
        "delay of the voltage",
    }
    assert {one.source for one in SIZES.imperfections([run])} > sources


def test_what_is_exact_is_left_out(run):
    assert Accuracy.exact().imperfections([run]) == ()
    (only,) = Accuracy(0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0).imperfections([run])
    assert (only.source, only.accuracy) == ("gain of the voltages", "1 %")


@pytest.mark.parametrize("value", [-0.01, np.nan, np.inf])
def test_an_impossible_accuracy_is_refused_by_name(value):
    with pytest.raises(InputError, match="accuracy voltage_gain"):
        Accuracy(voltage_gain=value)
