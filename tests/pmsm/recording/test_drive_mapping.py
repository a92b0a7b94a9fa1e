"""Columns of a file as channels of a drive: what is multiplied by what, and where it may stand."""

import numpy as np
import pytest

from penode.data.mapping import Origin
from penode.errors import InputError
from penode.pmsm.recording.drive_mapping import RECORDED, DriveMapping, DriveOrigin

AMPLITUDES, TURNING = {"u_d", "u_q", "i_d", "i_q"}, {"omega_el", "theta_el"}
ROWS = np.random.default_rng(3).normal(size=(20, 6))


@pytest.fixture
def file(tmp_path):
    """Return a file with the columns t, u_d, u_q, i_d, i_q, omega_el, theta_el."""
    path = tmp_path / "run.csv"
    table = np.column_stack([1e-3 * np.arange(20), ROWS])
    header = "t,u_d,u_q,i_d,i_q,omega_el,theta_el"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def origin(name, **flags):
    return DriveOrigin(Origin(name, RECORDED[name]), **flags)


def test_rms_becomes_peak_and_the_shafts_motion_the_electrical(file):
    names = ("t", "u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el")
    channels = {name: origin(name) for name in names}
    plain = DriveMapping(channels).load(file)
    np.testing.assert_allclose(plain.stack(names[1:]), ROWS)
    channels |= {name: origin(name, rms=True) for name in AMPLITUDES}
    channels |= {name: origin(name, mechanical=True) for name in TURNING}
    run = DriveMapping(channels, pole_pairs=3).load(file)
    factor = np.array([2**0.5] * 4 + [3.0] * 2)
    np.testing.assert_allclose(run.stack(names[1:]), ROWS * factor)
    assert run.time_step == pytest.approx(1e-3)


@pytest.mark.parametrize("name", RECORDED)
def test_only_amplitudes_are_rms_and_only_motion_is_of_the_shaft(name):
    for flag, allowed in (("rms", AMPLITUDES), ("mechanical", TURNING)):
        channels = {name: origin(name, **{flag: True})}
        if name in allowed:
            assert DriveMapping(channels, pole_pairs=2).channels == channels
            continue
        with pytest.raises(InputError, match=f"channel {name}: {flag} = true is for"):
            DriveMapping(channels, pole_pairs=2)


def test_what_is_of_the_shaft_needs_the_pole_pairs():
    with pytest.raises(InputError, match="theta_el is mechanical and pole_pairs is missing"):
        DriveMapping({"theta_el": origin("theta_el", mechanical=True)})
