"""What recordings can tell, and a repair that was tried."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from penode.pmsm.balance.start import weak_start
from penode.pmsm.balance.voltage_balance import BalanceForm
from penode.pmsm.machine.dead_time import DeadTime as DeadTimeTerm
from penode.pmsm.precheck.excitation import excitation_of
from penode.pmsm.precheck.identifiability import identifiability_of


@pytest.fixture(autouse=True)
def _one_thread():
    with threadpool_limits(limits=1, user_api="blas"):
        yield


def test_independence_is_that_of_the_start(slow_run):
    found = identifiability_of([slow_run], "coenergy", ())
    assert found.independence == pytest.approx(weak_start([slow_run], "coenergy")[1].independence)
    assert (found.indistinguishable, found.alarm, found.repair) == ((), "", "")


def test_a_free_map_at_one_speed_is_refused_and_the_reciprocal_map_is_the_repair(slow_run):
    found = identifiability_of([slow_run], "mlp", ())
    assert found.indistinguishable == ("R",)
    assert found.repair.startswith("Use a reciprocal map (--flux-map coenergy): the least")
    reached = float(found.repair.rstrip(".").split()[-1])
    told = identifiability_of([slow_run], "coenergy", ()).independence["R"]
    assert reached == pytest.approx(told, rel=0.05)


def test_dead_time_of_one_amplitude_wants_another(slow_run):
    """On a circle R and dead time both drop a voltage along the current."""
    angle = 15.0 * np.arange(len(slow_run)) * slow_run.time_step
    turning = {"i_d": 200 * np.cos(angle), "i_q": 200 * np.sin(angle)}
    run = replace(slow_run, channels={**slow_run.channels, **turning})
    found = identifiability_of([run], "coenergy", (DeadTimeTerm(),))
    assert found.indistinguishable == ("R", "dead_time_voltage")
    assert found.repair.startswith("Vary the amplitude of the currents: ")


def test_gauge_alarm_of_a_free_map(slow_run):
    """A voltage of 30 mohm along the current, all of which a skew part can stand for."""
    angle = 15.0 * np.arange(len(slow_run)) * slow_run.time_step
    turning = {"i_d": 200 * np.cos(angle), "i_q": 200 * np.sin(angle)}
    run = replace(slow_run, channels={**slow_run.channels, **turning})
    assert identifiability_of([run], "mlp", ()).alarm.startswith("Gauge alarm: ")
    assert identifiability_of([run], "coenergy", ()).alarm == ""


def test_excitation_of_a_disc_and_of_a_line(slow_run, unseen_run):
    found = excitation_of([slow_run, unseen_run])
    assert found.fraction > 0.7
    assert found.advice == ()
    assert found.speeds == pytest.approx((5 * 50 * np.pi, 5 * 30 * np.pi), rel=1e-6)
    line = {"i_d": np.zeros(len(slow_run)), "i_q": np.abs(slow_run.channels["i_q"])}
    run = replace(slow_run, channels={**slow_run.channels, **line})
    poor = excitation_of([run])
    assert poor.fraction == 0.0
    assert len(poor.advice) == 3


def test_the_profile_is_the_balance_solved_anew_with_r_held(slow_run):
    found = identifiability_of([slow_run], "coenergy", ())
    reciprocal, free = found.profiles
    assert (reciprocal.flux_map, free.flux_map) == ("reciprocal", "unconstrained")
    equations = BalanceForm.of([slow_run], True).solve([slow_run]).equations
    size = np.linalg.norm(equations.matrix, axis=0)
    matrix = equations.matrix / np.where(size > 0, size, 1)

    def residual(held):
        target = equations.target - equations.matrix[:, 0] * held
        rest = matrix[:, 1:]
        return np.linalg.norm(target - rest @ np.linalg.lstsq(rest, target, rcond=1e-10)[0])

    best = residual(reciprocal.resistance)
    for away in (-4e-3, 2e-3):
        held = reciprocal.resistance + away
        assert reciprocal.rise(held) == pytest.approx(residual(held) / best - 1, rel=1e-3)
    # Without reciprocity nothing holds R: what the picture shows as a flat line.
    assert free.steepness < 0.01 * reciprocal.steepness
