"""What a simulation did, from traces that are made up: torque, deviation, share beyond the map."""

from dataclasses import replace

import numpy as np
import pytest

from penode import Experiment, InputError
from penode.bench.drive import Drive
from penode.bench.machines import TRACTION_300A, torque
from penode.bench.run import Recording
from penode.bench.truth import Trace, Truth
from penode.pmsm.simulation.simulated_drive import COMPARED, deviation, share_beyond, torque_of
from penode.pmsm.simulation.simulated_files import GRID, write_recording

STEP, ROWS = 1e-4, 500


@pytest.fixture
def recording(rng):
    """Return a recording of random currents at one speed; nothing of it obeys a machine."""
    current = rng.uniform(-100.0, 100.0, (ROWS, 2))
    theta = 0.3 + 500.0 * STEP * np.arange(ROWS)
    trace = Trace(current, theta, np.full(ROWS, 500.0), np.full(ROWS, 20.0))
    truth = Truth(TRACTION_300A, Drive(), 955.0, lambda time: current, 0.05, 0, trace)
    channels = dict(zip(COMPARED, rng.normal(size=(4, ROWS)), strict=True))
    return Recording(Experiment("made up", STEP, {**channels, "omega_el": trace.omega_el}), truth)


def with_drive(recording, **changes):
    return Recording(recording.experiment, replace(recording.truth, drive=Drive(**changes)))


def test_torque_is_the_machines_and_warm_magnets_take_theirs_away(recording):
    """T falls by 3/2 p dpsi i_q where the magnets lose dpsi = 1.1e-3 per K of psi_PM."""
    i_d, i_q = recording.truth.trace.current.T
    cold = torque(TRACTION_300A, i_d, i_q, recording.truth.trace.theta_el)
    np.testing.assert_allclose(torque_of(recording), cold, rtol=1e-12)
    warm = torque_of(with_drive(recording, magnet_temperature=120.0))
    lost = 1.1e-3 * 100.0 * TRACTION_300A.magnet_flux_linkage
    np.testing.assert_allclose(cold - warm, 1.5 * 5 * lost * i_q, rtol=1e-9, atol=1e-9)


def recorded(recording, apart, **changes):
    """Return a recording beside it, its channels apart by so much in each of the four."""
    channels = {
        name: recording.experiment.channels[name] + difference
        for name, difference in zip(COMPARED, apart, strict=True)
    }
    channels |= {"omega_el": np.full(len(channels["i_d"]), 500.0)} | changes
    return Experiment("bench.csv", STEP, channels)


def test_deviation_is_the_rms_of_what_is_apart_once_the_currents_have_arrived(recording):
    """At a bandwidth of 1000 rad/s and 100 us, the first hundred rows are the start's."""
    unsettled = np.where(np.arange(ROWS) < 100, 1e6, 0.0)
    swinging = 0.5 * (-1.0) ** np.arange(ROWS)
    other = recorded(recording, (unsettled, unsettled + 2.0, swinging, unsettled - swinging))
    found = deviation(recording, other)
    assert found.name == "bench.csv"
    assert found.settled == pytest.approx(0.01)
    assert found.rms == pytest.approx({"i_d": 0.0, "i_q": 2.0, "u_d": 0.5, "u_q": 0.5})
    later = deviation(with_drive(recording, bandwidth=500.0), other)
    assert later.settled == pytest.approx(0.02)


def test_the_shorter_of_both_decides_how_much_is_compared(recording):
    whole = recorded(recording, (1.0, 1.0, 1.0, 1.0))
    ends = {name: values[:101] for name, values in whole.channels.items()}
    assert deviation(recording, replace(whole, channels=ends)).rms["i_q"] == pytest.approx(1.0)
    ends = {name: values[:100] for name, values in whole.channels.items()}
    with pytest.raises(InputError, match="100 rows can be compared, and 100 of them are needed"):
        deviation(recording, replace(whole, channels=ends))


@pytest.mark.parametrize("speed", [506.0, 494.0, -500.0])
def test_recordings_at_another_speed_or_step_are_not_held_against_it(recording, speed):
    nothing = (0.0, 0.0, 0.0, 0.0)
    other = recorded(recording, nothing, omega_el=np.full(ROWS, speed))
    with pytest.raises(
        InputError, match=rf"turns at {speed / 5 * 30 / np.pi:.6g} rpm, and .* at 954.93"
    ):
        deviation(recording, other)
    near = recorded(recording, nothing, omega_el=np.full(ROWS, 504.0))
    assert max(deviation(recording, near).rms.values()) == 0.0
    with pytest.raises(InputError, match=r"sampled every 0\.00011 s, the simulation every 0\.0001"):
        deviation(recording, replace(near, time_step=1.1e-4))


def test_the_share_beyond_counts_what_is_off_the_map_and_what_it_does_not_support(
    recording, tmp_path
):
    """Currents are drawn from a square of 200 A; the map spans 80 A by 120 A, half supported."""
    axes = np.linspace(-40.0, 40.0, 9), np.linspace(-60.0, 60.0, 9)
    i_d, i_q = (one.ravel() for one in np.meshgrid(*axes, indexing="ij"))
    table = np.column_stack([i_d, i_q, 0.05 + 1e-4 * i_d, 2e-4 * i_q, i_q > 1.0])
    header = "i_d,i_q,psi_d,psi_q,supported"
    np.savetxt(tmp_path / "flux_map.csv", table, delimiter=",", header=header, comments="")
    d, q = recording.truth.trace.current.T
    # Nearest point: half a step of 10 A and 15 A beyond the ends; of i_q from half of 15 A on.
    known = (np.abs(d) < 45.0) & (q < 67.5) & (q > 7.5)
    assert 0.05 < known.mean() < 0.3
    assert share_beyond(recording, tmp_path) == pytest.approx(1.0 - known.mean(), abs=1e-12)


def test_the_true_map_is_written_over_the_disc_that_was_visited(recording, tmp_path):
    story, table = write_recording(recording, tmp_path / "run.csv")
    assert (story.name, table.name) == ("run.truth.json", "run.truth.csv")
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    reach = np.hypot(*recording.truth.trace.current.T).max()
    assert np.hypot(rows[:, 0], rows[:, 1]).max() <= reach * (1 + 1e-8)
    assert len(rows) == pytest.approx(np.pi / 4 * (GRID - 1) ** 2, rel=0.01)
    at = rows[::97]
    np.testing.assert_allclose(recording.truth.flux_map(*at[:, :2].T), at[:, 2:], atol=1e-8)
