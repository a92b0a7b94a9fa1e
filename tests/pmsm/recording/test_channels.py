"""What a drive recording must have, and what is said when it has not."""

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.machine.term_registry import TERMS
from penode.pmsm.recording.channels import drive_recording, missing_channels, require_channels


def recording(**changes) -> Experiment:
    time = np.arange(400) * 1e-4
    channels = {
        "u_d": 5 * np.sin(30 * time),
        "u_q": 30 + np.cos(20 * time),
        "i_d": 100 * np.sin(50 * time),
        "i_q": 80 * np.cos(40 * time),
        "omega_el": np.full(400, 500.0),
    }
    channels = {n: v for n, v in {**channels, **changes}.items() if v is not None}
    return Experiment("drive.csv", 1e-4, channels)


def test_canonical_recording_passes_unchanged():
    run = recording()
    assert drive_recording(run) is run


def test_phase_quantities_give_the_same_recording():
    run = recording()
    theta = 500.0 * np.arange(400) * 1e-4
    channels = {"theta_el": theta}
    for kind in "ui":
        phases = abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), theta)
        channels |= {f"{kind}_{phase}": phases[:, k] for k, phase in enumerate("abc")}
    transformed = drive_recording(Experiment("drive.csv", 1e-4, channels))
    names = ("u_d", "u_q", "i_d", "i_q", "omega_el")
    np.testing.assert_allclose(transformed.stack(names), run.stack(names), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"u_q": None}, ("drive.csv", "u_q")),
        ({"omega_el": None}, ("drive.csv", "omega_el")),
        ({"i_d": np.full(400, 3.0)}, ("drive.csv", "i_d")),
        ({"omega_el": np.full(400, 5e4)}, ("drive.csv", "omega_el", "t in s")),
    ],
    ids=["missing voltage", "missing speed", "constant current", "speed against time step"],
)
def test_unusable_recordings_are_refused_in_one_sentence(changes, words):
    with pytest.raises(InputError) as refusal:
        drive_recording(recording(**changes))
    for word in words:
        assert word in str(refusal.value)


def test_time_in_milliseconds_is_noticed():
    run = recording()
    with pytest.raises(InputError, match="t in s, omega_el"):
        drive_recording(Experiment("drive.csv", 0.1, run.channels))


@pytest.mark.parametrize("kinds", ["", "u", "i", "ui"])
def test_one_channel_less_is_the_one_that_is_missing(kinds):
    """Of phase quantities the angle is needed, from which the speed follows; else the speed.

    Two phase currents are enough, as they sum to zero; phase voltages do not.
    """
    axes = {kind: {"u": "abc", "i": "ab"}[kind] if kind in kinds else "dq" for kind in "ui"}
    needed = [f"{kind}_{axis}" for kind in "ui" for axis in axes[kind]]
    needed.append("theta_el" if kinds else "omega_el")
    assert missing_channels([*needed, "omega_el", "theta_el", "torque"]) == []
    for name in needed:
        assert missing_channels([other for other in needed if other != name]) == [name]


def test_a_recorded_speed_is_not_made_anew_of_the_angle():
    theta = 490.0 * np.arange(400) * 1e-4
    phases = abc_from_dq(recording().stack(("i_d", "i_q")), theta)
    channels = {f"i_{phase}": phases[:, k] for k, phase in enumerate("abc")}
    run = recording(i_d=None, i_q=None, theta_el=theta, **channels)
    np.testing.assert_array_equal(drive_recording(run).channels["omega_el"], 500.0)


@pytest.mark.parametrize(("turn", "usable"), [(1.55, True), (1.59, False)])
def test_a_sample_turns_a_quarter_at_most(turn, usable):
    """A few spikes of the speed are no reason to refuse."""
    speed = np.full(400, turn / 1e-4)
    speed[::50] *= -3.0
    run = recording(omega_el=speed)
    if usable:
        assert drive_recording(run) is run
    else:
        with pytest.raises(InputError, match=r"turns 1\.59 rad a sample, must be < 1\.6"):
            drive_recording(run)


@pytest.mark.parametrize("kind", TERMS.values())
def test_a_terms_channels_are_there_and_within_their_limits(kind):
    good = {channel.name: np.full(400, 20.0) for channel in kind.channels}
    require_channels([recording(**good)], [kind()])
    for channel in kind.channels:
        with pytest.raises(InputError, match=f"drive.csv: channel {channel.name} is missing"):
            require_channels([recording(**{**good, channel.name: None})], [kind()])
        for limit, beyond in ((channel.lowest, -1.0), (channel.highest, 1.0), (0.0, np.nan)):
            values = np.full(400, 20.0)
            values[7:9] = limit + beyond
            run = recording(**{**good, channel.name: values})
            if np.isinf(limit):
                require_channels([run], [kind()])
                continue
            with pytest.raises(InputError, match=f"data row 8, channel {channel.name} is"):
                require_channels([recording(**good), run], [kind()])


def test_a_map_over_the_angle_needs_the_angle():
    require_channels([recording()], [])
    with pytest.raises(InputError, match="a map with angle orders needs the electrical angle"):
        require_channels([recording()], [], (6,))
