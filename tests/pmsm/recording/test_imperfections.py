"""Imperfections of a recording chain, each against what it does to three phases."""

import numpy as np
import pytest

from penode import Experiment, InputError
from penode.pmsm.machine.frames import abc_from_dq, dq_from_abc
from penode.pmsm.recording.imperfection import KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS, Accuracy, budget_rows

STEP, SPEED = 1e-4, 700.0
SIZES = Accuracy(
    current_gain=0.01,
    voltage_gain=0.02,
    current_mismatch=0.004,
    current_offset=0.003,
    speed_gain=0.001,
    angle=2.0,
    delay=0.25,
)


def rows(accuracy, run):
    """Return what recordings may be wrong by, where they show nothing of it."""
    return budget_rows(accuracy.deviations([run]), [run], KnownDrive())


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
    every = [one for one in rows(SIZES, run) if one.source == source]
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
    whole = IMPERFECTIONS["angle"].corrected(run, np.deg2rad(2.0), KnownDrive())
    for letter in "iu":
        phases = abc_from_dq(dq(run, letter), run.channels["theta_el"])
        np.testing.assert_allclose(dq(whole, letter), dq_from_abc(phases, late), atol=1e-9)
        np.testing.assert_allclose(dq(other, letter), dq(whole, letter), atol=0.1)
    for one in (other, whole):
        np.testing.assert_allclose(one.channels["theta_el"], late)


def test_a_delay_mixes_each_voltage_with_the_one_before(run):
    (other,) = changed(run, "delay of the voltage")
    before = dq(run, "u")
    np.testing.assert_allclose(dq(other, "u")[1:], 0.75 * before[1:] + 0.25 * before[:-1])
    np.testing.assert_array_equal(dq(other, "u")[0], before[0])
    np.testing.assert_array_equal(dq(other, "i"), dq(run, "i"))


def test_offsets_are_constant_in_the_phases(run):
    largest = np.hypot(*dq(run, "i").T).max()
    for other, axis in zip(changed(run, "offset of the currents"), (0.0, np.pi / 2), strict=True):
        error = abc_from_dq(dq(run, "i") - dq(other, "i"), run.channels["theta_el"])
        expected = 0.003 * largest * np.cos(axis - np.array([0, 2, -2]) * np.pi / 3)
        np.testing.assert_allclose(error, np.broadcast_to(expected, error.shape), atol=1e-12)


def test_one_of_the_mismatches_is_that_of_phase_a_against_the_others(run):
    """The stationary axis of phase a loses what the one across it gains."""
    other, across = changed(run, "gains of the phases among each other")
    turned = np.exp(1j * run.channels["theta_el"])
    stationary = (run.channels["i_d"] + 1j * run.channels["i_q"]) * turned
    expected = 0.996 * stationary.real + 1.004j * stationary.imag
    got = (other.channels["i_d"] + 1j * other.channels["i_q"]) * turned
    np.testing.assert_allclose(got, expected, atol=1e-10)
    mixed = (across.channels["i_d"] + 1j * across.channels["i_q"]) * turned
    expected = stationary - 0.004 * (stationary.imag + 1j * stationary.real)
    np.testing.assert_allclose(mixed, expected, atol=1e-10)


def test_none_of_no_deviation_changes_anything(run):
    for one in rows(SIZES, run):
        other = one.applied(run, 0.0)
        for name, values in run.channels.items():
            np.testing.assert_allclose(other.channels[name], values, atol=1e-12)


def test_phases_need_the_angle(run):
    channels = {name: v for name, v in run.channels.items() if name != "theta_el"}
    blind = Experiment("run.csv", STEP, channels)
    sources = {one.source for one in rows(SIZES, blind)}
    assert sources == {
        "gain of the currents",
        "gain of the voltages",
        "gain of the speed",
        "angle of the d axis",
        "delay of the voltage",
    }
    assert {one.source for one in rows(SIZES, run)} > sources


def test_what_is_exact_is_left_out(run):
    assert rows(Accuracy.exact(), run) == ()
    (only,) = rows(Accuracy(**{**Accuracy.exact().declared, "voltage_gain": 0.01}), run)
    assert (only.source, only.accuracy) == ("gain of the voltages", "1 %")
    some = Accuracy(voltage_gain=0.01)
    assert (some.origin("voltage_gain"), some.origin("angle")) == ("declared", "assumed")
    assert some.origin("iron") == ""


@pytest.mark.parametrize("value", [-0.01, np.nan, np.inf])
def test_an_impossible_accuracy_is_refused_by_name(value):
    with pytest.raises(InputError, match="accuracy voltage_gain"):
        Accuracy(voltage_gain=value)
