"""The voltage along the current that an inverter takes: closed forms, and what follows from it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from tests.pmsm.control.test_loci import LIMIT, LINEAR

from penode.errors import InputError
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.inverter_voltage import InverterVoltage
from penode.pmsm.control.loci import (
    base_speed,
    characteristic_current,
    most_torque_over_speed,
    mtpa,
    mtpv,
    voltage_limit_curve,
)
from penode.pmsm.machine.dead_time import DeadTime, MeanDeadTime, PhaseDeadTime
from penode.pmsm.machine.frames import quarter_turned
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance

VOLTS, WIDTH = 4.0, 20.0
KNEE = DeadTime(dead_time_voltage=VOLTS, dead_time_current=WIDTH)


def of_terms(*terms):
    """Return what the inverter of a machine with terms takes, whatever its map is."""
    return InverterVoltage.of(Machine(flux=None, terms=terms), LIMIT)


def taken(size):
    """Return the mean of the knee in V: 2/3 of the sum over three phases, each of which has it."""

    def along(angle):
        return 2 * VOLTS * np.tanh(size * np.cos(angle) / WIDTH) * np.cos(angle)

    return quad(along, 0, 2 * np.pi, limit=200)[0] / (2 * np.pi)


def driven():
    """Return a linear machine with R and the inverter's voltage."""
    return replace(LINEAR, resistance=0.02, inverter=of_terms(Resistance(0.02), KNEE))


def test_much_current_is_taken_the_textbooks_mean_and_a_knee_its_integral():
    sharp = of_terms(DeadTime(dead_time_voltage=VOLTS, dead_time_current=1e-3))
    np.testing.assert_allclose(sharp.voltage[20:], 4 / np.pi * VOLTS, rtol=1e-4)
    soft = of_terms(KNEE)
    for k in (5, 20, 40, 64):
        assert soft.voltage[k] == pytest.approx(taken(soft.size[k]), rel=1e-6)


def test_phases_that_differ_take_their_mean_and_the_mean_itself_as_it_is():
    by_phase = PhaseDeadTime(
        dead_time_voltage_a=3.0,
        dead_time_voltage_b=4.0,
        dead_time_voltage_c=5.0,
        dead_time_current=WIDTH,
    )
    np.testing.assert_allclose(of_terms(by_phase).voltage, of_terms(KNEE).voltage, atol=1e-9)
    mean = of_terms(MeanDeadTime(inverter_voltage=5.0, knee_current=1e-3))
    np.testing.assert_allclose(mean.voltage[1:], 5.0, rtol=1e-3)


def test_nothing_is_taken_without_dead_time_or_currents():
    assert of_terms(Resistance(0.02)) is None
    assert InverterVoltage.of(Machine(flux=None, terms=(KNEE,)), 0.0) is None


@pytest.mark.parametrize("current", [(-80.0, 120.0), (3.0, -4.0), (0.0, 390.0), (-300.0, 400.0)])
def test_slopes_of_the_voltage_are_its_differences(current):
    machine, at, step = driven(), np.array(current)[:, None], 1e-4
    slope = machine.voltage_slope(at, 500.0)[..., 0]
    for k in range(2):
        aside = step * np.eye(2)[:, [k]]
        change = machine.voltage(at + aside, 500.0) - machine.voltage(at - aside, 500.0)
        np.testing.assert_allclose(slope[:, k], change[:, 0] / (2 * step), rtol=1e-5, atol=1e-7)


def test_no_current_takes_no_voltage():
    np.testing.assert_array_equal(driven().voltage(np.zeros((2, 1)), 0.0), 0.0)


def test_full_torque_ends_where_the_command_meets_its_limit():
    """The command has what the inverter takes beside; without it full torque would go on."""
    machine, limit = driven(), 120.0
    speed = base_speed(machine, LIMIT, limit)
    full = mtpa(machine, np.array([LIMIT])).current
    size = np.hypot(*full)
    command = (0.02 + taken(size[0]) / size) * full + speed * machine.pole_pairs * quarter_turned(
        machine.flux_map(*full)
    )
    assert np.hypot(*command)[0] == pytest.approx(limit, rel=1e-5)
    assert speed < 0.985 * base_speed(replace(machine, inverter=None), LIMIT, limit)
    speeds = speed * np.array([0.999, 1.5])
    torque = most_torque_over_speed(machine, speeds, LIMIT, limit).torque
    most = mtpa(machine, np.array([LIMIT])).torque[0]
    assert torque[0] == pytest.approx(most, rel=1e-6)
    current = most_torque_over_speed(machine, speeds, LIMIT, limit).current[:, 1:]
    volts = machine.voltage(current, speeds[1] * machine.pole_pairs)
    assert np.hypot(*volts)[0] == pytest.approx(limit, rel=1e-6)


def test_a_machine_and_its_mirror_take_the_same():
    machine, current = driven(), np.array([[-80.0], [120.0]])
    mirrored = machine.mirrored().voltage(current * [[1.0], [-1.0]], -500.0)
    np.testing.assert_allclose(mirrored * [[1.0], [-1.0]], machine.voltage(current, 500.0))


def test_flux_linkage_knows_no_inverter():
    """What high speed allows, and the steady short circuit, are of the map alone."""
    machine, fluxes = driven(), np.linspace(0.01, 0.05, 5)
    plain = replace(LINEAR, resistance=0.02)
    np.testing.assert_array_equal(
        mtpv(machine, fluxes, LIMIT).current, mtpv(plain, fluxes, LIMIT).current
    )
    np.testing.assert_array_equal(
        characteristic_current(machine, LIMIT).current, characteristic_current(plain, LIMIT).current
    )


def test_the_limit_of_the_voltage_is_drawn_where_the_command_is_at_it():
    locus = voltage_limit_curve(driven(), 40.0, 12.0, LIMIT)
    current = locus.current[:, np.isfinite(locus.current).all(axis=0)]
    assert current.shape[1] > 100
    volts = np.hypot(*driven().voltage(current, 40.0 * driven().pole_pairs))
    np.testing.assert_allclose(volts, 12.0, rtol=1e-6)


def test_too_little_voltage_for_the_current_at_standstill_is_refused():
    with pytest.raises(InputError, match=r"drop at standstill, 13.1 V at 400 A, got 10 V"):
        base_speed(driven(), LIMIT, 10.0)


@pytest.mark.parametrize("answered", [True, False])
def test_a_fit_brings_its_dead_time_where_r_is_answered(answered):
    fit = SimpleNamespace(
        provenance={"pole_pairs": 4},
        horizon=SimpleNamespace(answered=answered),
        parameters={"R": SimpleNamespace(value=0.02)},
        model=Machine(flux=None, terms=(Resistance(0.02), KNEE)),
        excited=np.array([[0.0, 100.0], [-240.0, 320.0]]),
        flux_map=LINEAR.flux_map,
        differential_inductance=LINEAR.differential_inductance,
        supported=LINEAR.supported,
    )
    machine, current = ControlledMachine.of(fit), np.array([[0.0], [300.0]])
    expected = 0.02 * 300.0 + taken(300.0) if answered else 0.0
    np.testing.assert_allclose(machine.drop(current), [[0.0], [expected]], rtol=1e-4, atol=1e-9)
    assert not answered or machine.inverter.size[-1] == 400.0
