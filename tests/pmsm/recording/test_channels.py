"""What a drive recording must have, and what is said when it has not."""

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.recording.channels import drive_recording


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
        ({"omega_el": np.full(400, 5e4)}, ("drive.csv", "omega_el", "seconds")),
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
    with pytest.raises(InputError, match="give t in seconds"):
        drive_recording(Experiment("drive.csv", 0.1, run.channels))
