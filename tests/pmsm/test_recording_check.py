"""What a check of recordings takes from a study."""

from dataclasses import replace

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.pmsm.recording_check import check_recordings
from penode.pmsm.study_settings import Study

pytestmark = pytest.mark.usefixtures("quickly_compiled")


def test_the_hold_of_the_study_is_that_of_the_check(unseen_run):
    """The voltage at the start of a sample, held in the stationary frame: dq sees its mean."""
    channels = {name: values[:1500] for name, values in unseen_run.channels.items()}
    run = Experiment("run", unseen_run.time_step, channels)
    turn = -1j * channels["omega_el"] * run.time_step
    start = (channels["u_d"] + 1j * channels["u_q"]) * turn / np.expm1(turn)
    held = replace(run, channels={**channels, "u_d": start.real, "u_q": start.imag})
    seen = {"dq": (run, channels["u_d"]), "stationary": (held, channels["u_d"])}
    for hold, (recording, expected) in seen.items():
        found = check_recordings([recording], Study(hold=hold))
        assert not any("stationary frame" in reason for reason in found.structure)
        np.testing.assert_allclose(found.drives[0].channels["u_d"], expected, atol=1e-9)
    (broken,) = check_recordings([held], Study(hold="dq")).broken
    assert broken.name == "frame of the hold"
