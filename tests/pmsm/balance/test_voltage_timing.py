"""When and in which frame a recorded voltage acts: estimated, applied, and left alone."""

from dataclasses import replace

import numpy as np
import pytest

from penode.models.inputs import Inputs
from penode.pmsm.balance.voltage_timing import VoltageTiming, voltage_timing
from penode.pmsm.machine.holds import HOLDS, mean_over_samples, turned_voltage

VOLTAGES = ("u_d", "u_q")


def recorded(run, change):
    """Return a recording whose voltages (time, 2) are another function of those that act."""
    u_d, u_q = change(run.stack(VOLTAGES)).T
    return replace(run, channels={**run.channels, "u_d": u_d, "u_q": u_q})


def early_by_a_fraction(acting):
    """Return a voltage of which 0.6 of a sample acts, and 0.4 of the sample before."""
    log = acting.copy()
    for k in range(1, len(log)):
        log[k] = (acting[k] - 0.4 * log[k - 1]) / 0.6
    return log


def test_a_voltage_in_place_is_left_alone(slow_run, fast_run, dead_time_run):
    for run in (slow_run, fast_run, dead_time_run):
        assert voltage_timing([run]) == VoltageTiming()


@pytest.mark.parametrize("samples", [1, 2, -1])
def test_a_whole_delay(slow_run, samples):
    found = voltage_timing([recorded(slow_run, lambda u: np.roll(u, -samples, axis=0))])
    assert (found.delay, found.hold, found.turn) == (samples, "dq", 0.0)
    assert f"a delay of {samples}" in found.reason


def test_a_fraction_of_a_sample(slow_run):
    run = recorded(slow_run, early_by_a_fraction)
    found = voltage_timing([run])
    assert found.delay == pytest.approx(0.4, abs=0.03)
    applied = VoltageTiming(0.4).applied(run)
    np.testing.assert_allclose(applied.stack(VOLTAGES), slow_run.stack(VOLTAGES)[1:], atol=1e-9)
    np.testing.assert_array_equal(applied.channels["i_d"], slow_run.channels["i_d"][1:])


def test_a_hold_in_the_stationary_frame(slow_run):
    """A recording whose voltage, turned ahead by half a sample, has the mean that acted."""
    run = turned_voltage(slow_run, 0.5)
    found = voltage_timing([run])
    assert (found.delay, found.hold, found.turn) == (0.0, "stationary", 0.0)
    acting = found.acting(found.applied(run)).stack(VOLTAGES)
    np.testing.assert_allclose(acting, slow_run.stack(VOLTAGES), rtol=1e-3)


def test_another_turn(slow_run):
    run = turned_voltage(slow_run, 1.0)
    found = voltage_timing([run])
    assert found.turn == pytest.approx(-1.0, abs=0.03)
    applied = replace(found, turn=-1.0).applied(run)
    np.testing.assert_allclose(applied.stack(VOLTAGES), slow_run.stack(VOLTAGES), atol=1e-9)


@pytest.mark.parametrize("delay", [1.0, -1.0, 2.3, -0.7])
def test_what_is_applied_keeps_rows_together(slow_run, delay):
    applied = VoltageTiming(delay).applied(slow_run)
    lengths = {len(channel) for channel in applied.channels.values()}
    assert len(lengths) == 1
    first = slow_run.channels["theta_el"].tolist().index(applied.channels["theta_el"][0])
    position = np.arange(len(applied)) + first - delay
    expected = np.interp(position, np.arange(len(slow_run)), slow_run.channels["u_q"])
    np.testing.assert_allclose(applied.channels["u_q"], expected, rtol=1e-9, atol=1e-9)


def test_a_standstill_shows_no_turn(slow_run):
    still = replace(slow_run, channels={**slow_run.channels, "omega_el": np.zeros(len(slow_run))})
    assert voltage_timing([still]).turn == 0.0


def test_the_mean_over_a_sample_is_that_of_the_hold(slow_run):
    names = (*VOLTAGES, "omega_el")
    rows = slow_run.stack(names)[100:104].T
    fractions = (np.arange(400) + 0.5) / 400
    hold, step = HOLDS["stationary"], slow_run.time_step
    held = [hold(lambda k: Inputs(rows, names), 0, f, step)[VOLTAGES] for f in fractions]
    found = mean_over_samples(slow_run).stack(VOLTAGES)[100:104].T
    np.testing.assert_allclose(found, np.mean(held, axis=0), rtol=1e-5)
