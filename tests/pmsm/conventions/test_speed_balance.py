"""The balance for any factor of the speed: sums of two speeds, made from one set of columns."""

from dataclasses import replace

import numpy as np
import pytest

from penode.pmsm.balance.trial_balance import trial_form
from penode.pmsm.conventions.speed_balance import SpeedBalance
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE
from penode.pmsm.recording.imperfections import IMPERFECTIONS


@pytest.mark.parametrize(("place", "factor"), [(0, 0.0), (1, 1.0)])
def test_sums_are_those_of_a_recording_at_that_speed(slow_run, place, factor):
    length, channels = 40, slow_run.channels
    moved = replace(slow_run, channels={**channels, "omega_el": factor * channels["omega_el"]})
    beside = [c for n in ("delay", "turn") for c in IMPERFECTIONS[n].columns(moved, UNKNOWN_DRIVE)]
    expected = trial_form([moved], 6).equations([moved], length, [beside])
    sums = SpeedBalance(slow_run, length)._sums[place]
    np.testing.assert_allclose(sums.matrix, expected.matrix, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(sums.target, expected.target, rtol=1e-12, atol=1e-12)
