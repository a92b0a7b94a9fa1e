"""Voltages injected at standstill, one axis a file: what a drive records when commissioned."""

from dataclasses import replace

import numpy as np
import pytest
from tests.pmsm.injection import Reluctance, injected, one_axis_a_file

from penode.pmsm.balance.calibration_fit import calibration_of
from penode.pmsm.recording.imperfections import Accuracy
from penode.pmsm.recording_check import check_recordings
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

pytestmark = pytest.mark.usefixtures("quickly_compiled")

BOTH = (110.0, 200.0)
OPEN = {"candidates": (), "angle_orders": (), "accuracy": Accuracy.exact()}


def commissioning(**changed):
    """Return a recording of both axes beside those of one axis each."""
    return [injected("both.csv", BOTH, samples=1000, **changed), *one_axis_a_file(**changed)]


@pytest.mark.parametrize("delay", [0, 2, 3])
def test_recordings_of_one_axis_each_have_one_delay(delay):
    found = calibration_of(one_axis_a_file(delay=delay))
    assert found.sizes == ({"delay": float(delay)} if delay else {})


def test_an_angle_is_that_of_the_recording_with_both_axes():
    angle = np.deg2rad(2.0)
    both = injected("both.csv", BOTH, samples=1000, delay=2, angle=angle)
    found = calibration_of([both, *one_axis_a_file(delay=2)])
    assert found["delay"] == 2.0
    assert abs(found["angle"].real - angle) < 3 * found.deviation["angle"] < angle / 2
    assert calibration_of(one_axis_a_file(delay=2))["angle"] == 0.0


@pytest.mark.parametrize("iron", [0.0, 5e-4])
def test_iron_that_lets_the_flux_lag_behind_the_current_is_found_beside_the_delay(iron):
    found = calibration_of(commissioning(delay=2, machine=Reluctance(iron=iron)))
    assert found["delay"] == 2.0
    if iron:
        assert abs(found["iron"].real - iron) < 3 * found.deviation["iron"] < iron / 4
    else:
        assert found["iron"] == 0.0


def test_a_check_names_an_axis_that_no_recording_excites_and_no_other_fault():
    d, q = one_axis_a_file()
    together, alone = check_recordings([d, q], Study(**OPEN)), check_recordings([d], Study(**OPEN))
    for found in (together, alone):
        assert found.broken == ()
        assert any("a delay of 3" in reason for reason in found.structure)
    assert together.quality == ()
    (finding,) = alone.quality
    assert "nothing is learned of the q axis" in finding.sentence


@pytest.mark.parametrize("of", ["u", "i"])
def test_channels_that_have_nothing_to_do_with_each_other_are_refused(of):
    both = injected("both.csv", BOTH, samples=1000)
    order = np.random.default_rng(0).permutation(len(both))
    mixed = {name: both.channels[name][order] for name in (f"{of}_d", f"{of}_q")}
    found = check_recordings([replace(both, channels={**both.channels, **mixed})], Study(**OPEN))
    assert [broken.name for broken in found.broken] == ["no synchronous machine"]


def test_resistance_and_map_follow_from_one_axis_a_file():
    machine = Reluctance()
    fit = identify(one_axis_a_file(), study=Study(horizon=18, **OPEN))
    assert fit.horizon.objections == ()
    assert not any("clipped" in warning for warning in fit.warnings)
    low, high = fit.parameters["R"].interval_95
    assert low < machine.resistance < high
    assert high - low < 0.05 * machine.resistance
    for axis in range(2):
        currents = np.zeros((9, 2))
        currents[:, axis] = np.linspace(-4.0, 4.0, 9)
        found, true = np.asarray(fit.flux_map(*currents.T)).T, machine.flux(currents)
        np.testing.assert_allclose(found[:, axis], true[:, axis], atol=0.01 * np.ptp(true))


def test_horizons_at_standstill_reach_as_far_as_short_recordings_allow(slow_run):
    plan = Study(angle_orders=()).plan(one_axis_a_file())
    assert [stage.horizon for stage in plan.stages] == [1, 3, 8, 18, 40, 90, 200]
    assert plan.placement.fewest > 1
    assert Study(angle_orders=()).plan([slow_run]).placement.fewest == 1
