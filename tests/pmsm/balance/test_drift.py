"""Resistance and magnets that change over a recording: estimated, taken off, and what is left."""

from dataclasses import replace

import numpy as np
import pytest

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.pmsm.balance.drift import Drift, _drifting, drift_of
from penode.pmsm.machine.terms import MagnetTemperature, TemperatureResistance
from penode.pmsm.recording.imperfection import KnownDrive
from penode.pmsm.recording.imperfections import budget_rows

VOLTAGES = ("u_d", "u_q")
R = TRACTION_300A.resistance


@pytest.fixture(scope="module")
def steady_run():
    reference = Lissajous(240.0, 50.0, 43.0)
    return simulate(TRACTION_300A, reference, speed_rpm=600.0, duration=0.5)


def drifting(run, of_resistance, of_magnet):
    """Return the voltages that a machine with the drift takes: those of a steady one and its own.

    Written down anew: tau is the fraction of the recording that is over, less a half.
    """
    time = np.arange(len(run)) * run.time_step
    tau = time / time[-1] - 0.5
    channels = dict(run.channels)
    channels["u_d"] = channels["u_d"] + of_resistance * tau * channels["i_d"] + of_magnet / time[-1]
    channels["u_q"] = (
        channels["u_q"]
        + of_resistance * tau * channels["i_q"]
        + channels["omega_el"] * of_magnet * tau
    )
    return replace(run, channels=channels)


@pytest.mark.parametrize(("share", "magnet"), [(0.1, 0.0), (-0.2, -6e-4), (0.0, 3e-4)])
def test_a_drift_is_estimated_and_taken_off(steady_run, share, magnet):
    run = drifting(steady_run, share * R, magnet)
    drift = drift_of([run])
    assert drift.sizes["resistance_drift"][0] == pytest.approx(share * R, rel=0.1, abs=1e-9)
    assert drift.sizes["magnet_drift"][0] == pytest.approx(magnet, rel=0.1, abs=1e-9)
    assert len(drift.reasons) == (share != 0) + (magnet != 0)
    known = Drift({"resistance_drift": (share * R,), "magnet_drift": (magnet,)})
    (steady,) = known.applied([run])
    np.testing.assert_allclose(steady.stack(VOLTAGES), steady_run.stack(VOLTAGES), atol=1e-9)


def test_without_the_rotors_angle_an_inverter_is_no_drift(dead_time_run):
    run = drifting(dead_time_run, 0.2 * R, 0.0)
    bare = {name: one for name, one in run.channels.items() if name != "theta_el"}
    drift = drift_of([replace(run, channels=bare)])
    assert drift.sizes["resistance_drift"][0] == pytest.approx(0.2 * R, rel=0.05)


def test_a_steady_machine_is_left_alone(steady_run, slow_run):
    drift = drift_of([steady_run, slow_run])
    assert drift.sizes == dict.fromkeys(("resistance_drift", "magnet_drift"), (0.0, 0.0))
    assert drift.reasons == ()
    assert drift.applied([steady_run, slow_run]) == [steady_run, slow_run]


def test_every_recording_has_a_drift_of_its_own(steady_run):
    warming, cooling = (drifting(steady_run, share * R, 0.0) for share in (0.1, -0.05))
    drift = drift_of([warming, cooling])
    np.testing.assert_allclose(drift.sizes["resistance_drift"], [0.1 * R, -0.05 * R], rtol=0.1)


def test_a_recorded_temperature_leaves_no_drift_of_the_resistance(steady_run):
    warm = {"winding_temperature": np.full(len(steady_run), 20.0)}
    run = replace(steady_run, channels={**steady_run.channels, **warm})
    drift = drift_of([drifting(run, 0.1 * R, 0.0)], (TemperatureResistance(),))
    assert "resistance_drift" not in drift.sizes


def test_what_is_left_of_a_drift_is_in_the_budget(steady_run):
    left = {"resistance_drift": 2e-4, "magnet_drift": 3e-6}
    assert budget_rows({}, [steady_run], KnownDrive()) == ()
    rows = budget_rows(left, [steady_run], KnownDrive())
    assert [row.source for row in rows] == ["drift of R", "drift of the magnets"]
    assert [(row.accuracy, row.origin) for row in rows] == [
        ("0.2 mΩ", "estimated"),
        ("0.003 mVs", "estimated"),
    ]
    for row, of_resistance, of_magnet in zip(rows, (2e-4, 0.0), (0.0, 3e-6), strict=True):
        found = row.applied(steady_run, -2.0).stack(VOLTAGES)
        expected = drifting(steady_run, 2 * of_resistance, 2 * of_magnet).stack(VOLTAGES)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_stretches_of_a_recording_share_its_clock(steady_run):
    """R of two stretches at the ends of a drift is that of the middle, which lies in the gap."""
    run = drifting(steady_run, 0.1 * R, 0.0)
    stretches = [run.part(0, 1800), run.part(3100, 5000)]
    drift = drift_of(stretches)
    assert (
        drift.sizes["resistance_drift"][0]
        == drift.sizes["resistance_drift"][1]
        == pytest.approx(0.1 * R, rel=0.1)
    )
    assert drift.reasons[0].startswith(f"{run.name}: R changes by 10 ")
    assert len(drift.reasons) == 1
    known = Drift({"resistance_drift": (0.1 * R,) * 2})
    for steady, place in zip(known.applied(stretches), ((0, 1800), (3100, 5000)), strict=True):
        expected = steady_run.stack(VOLTAGES)[slice(*place)]
        np.testing.assert_allclose(steady.stack(VOLTAGES), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("term", "left"),
    [(TemperatureResistance(), "magnet_drift"), (MagnetTemperature(), "resistance_drift")],
)
def test_a_term_that_follows_a_temperature_leaves_the_drift_of_the_other_part(term, left):
    assert _drifting(()) == ["resistance_drift", "magnet_drift"]
    assert _drifting((term,)) == [left]
