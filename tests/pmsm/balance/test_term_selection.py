"""Terms are switched on where the recording shows them and can identify them, and only there."""

import re
from dataclasses import replace

import numpy as np
import pytest

from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime as BenchDeadTime
from penode.bench.inverter import Inverter
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.pmsm.balance.term_selection import order_power, structure_of
from penode.pmsm.balance.voltage_balance import BalanceForm, PolynomialMap, term_columns
from penode.pmsm.machine.dead_time import DeadTime, MeanDeadTime
from penode.pmsm.machine.space_vectors import less_voltage
from penode.pmsm.machine.term_registry import completed
from penode.pmsm.study_settings import Study


@pytest.fixture(scope="module")
def plain_run():
    """A machine whose harmonics are a millionth of the usual, behind a drive without dead time."""
    iron = TRACTION_300A.coenergy
    faint = tuple((order, 1e-6 * a, 1e-6 * b) for order, a, b in iron.harmonics)
    machine = replace(TRACTION_300A, coenergy=replace(iron, harmonics=faint))
    drive = Drive(current_noise=0.2)
    reference = Lissajous(240.0, 50.0, 43.0)
    return simulate(machine, reference, speed_rpm=1000.0, duration=0.5, drive=drive, seed=3)


def circle(time):
    """150 A at an angle that turns at 50 rad/s, (time, 2)."""
    return 150.0 * np.stack([np.cos(50.0 * time), np.sin(50.0 * time)], axis=1)


def test_harmonics_and_no_dead_time_on_an_ideal_drive(slow_run):
    found = structure_of([slow_run], "coenergy")
    assert found.terms == ()
    assert found.angle_orders == (6, 12)
    assert "left out" in found.term_reasons[0]
    assert "amplitudes at orders 6 and 12" in found.angle_reasons[0]


def test_dead_time_is_seen_and_sized(dead_time_run):
    found = structure_of([dead_time_run], "coenergy")
    assert [type(term) for term in found.terms] == [DeadTime]
    assert found.angle_orders == (6, 12)
    assert re.search(r"shows some 2\.(3[5-9]|4[0-5])", found.term_reasons[0])


def test_nothing_where_there_is_nothing(plain_run):
    found = structure_of([plain_run], "coenergy")
    assert found.terms == ()
    assert found.angle_orders == ()


def test_a_dead_time_below_zero_is_said_to_be_none(plain_run):
    (term,) = (DeadTime().prepared(100.0),)
    lost = term_columns(plain_run, (term,))[1][..., 0]
    found = structure_of([less_voltage(plain_run, 0.5 * lost)], "coenergy")
    assert found.terms == ()
    assert re.search("shows -0.* V .std. of it, and a negative one is none", found.term_reasons[0])


def test_dead_time_that_r_can_stand_in_for_is_left_out():
    """On a circle of one current amplitude both drop a voltage along the current."""
    drive = Drive(inverter=Inverter(dead_time=BenchDeadTime(0.6e-6)))
    run = simulate(TRACTION_300A, circle, speed_rpm=1000.0, duration=0.5, drive=drive)
    found = structure_of([run], "coenergy")
    assert found.terms == ()
    assert "record several amplitudes" in found.term_reasons[0]


def test_a_map_that_cannot_follow_the_angle_says_so(slow_run):
    found = structure_of([slow_run], "spline")
    assert found.angle_orders == ()
    assert "coenergy, convex and mlp can" in found.angle_reasons[0]


def test_an_order_beyond_the_samples_is_left_out(slow_run):
    """Every fourth sample: order 12 at 1500 rpm has 6.25 of them a period."""
    coarse = replace(
        slow_run,
        time_step=4 * slow_run.time_step,
        channels={name: values[::4] for name, values in slow_run.channels.items()},
    )
    found = structure_of([coarse], "coenergy")
    assert 12 not in found.angle_orders


def without_angle(run):
    kept = {name: c for name, c in run.channels.items() if name != "theta_el"}
    return replace(run, channels=kept)


def test_without_the_angle_no_voltage_is_made_up(slow_run):
    found = structure_of([without_angle(slow_run)], "coenergy")
    assert (found.terms, found.angle_orders) == ((), ())
    assert "theta_el, which was not recorded" in found.term_reasons[0]


def test_without_the_angle_dead_time_is_its_mean_along_the_current(dead_time_run):
    found = structure_of([without_angle(dead_time_run)], "coenergy")
    assert [type(term) for term in found.terms] == [MeanDeadTime]
    shown = float(re.search(r"shows some (\S+) V", found.term_reasons[0])[1])
    assert shown == pytest.approx(4 / np.pi * 2.4, rel=0.05)
    certain = structure_of([without_angle(dead_time_run)], "coenergy", (DeadTime(),), ())
    assert [type(term) for term in certain.terms] == [MeanDeadTime]


def test_what_the_user_says_stands(slow_run):
    told = Study(terms=(DeadTime(dead_time_current=2.0),), candidates=(), angle_orders=())
    assert told.decided([slow_run]) == (told, (), ())
    half, reasons, _ = Study(angle_orders=(6,)).decided([slow_run])
    assert (half.terms, half.angle_orders) == ((), (6,))
    assert len(reasons) == 1


def test_power_of_an_order_is_that_of_its_voltage(slow_run):
    """Adding a voltage at order 9 adds its power to that order and to no other."""
    balance = BalanceForm(PolynomialMap(True, 250.0), completed(())).solve([slow_run])
    theta = (
        slow_run.channels["theta_el"] + 0.5 * slow_run.time_step * (slow_run.channels["omega_el"])
    )
    extra = {"u_d": np.cos(9 * theta), "u_q": np.sin(9 * theta)}
    added = {name: slow_run.channels[name] + v for name, v in extra.items()}
    louder = replace(slow_run, channels={**slow_run.channels, **added})
    orders = (8, 9, 10)
    before, after = (order_power([run], balance, orders) for run in (slow_run, louder))
    count = len(slow_run) - 1
    assert after[9] == pytest.approx(count, rel=0.02)
    assert all(abs(after[n] - before[n]) < 0.02 * count for n in (8, 10))
