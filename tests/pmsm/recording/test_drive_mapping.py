"""Columns of a file as channels of a drive: what is multiplied by what, and where it may stand."""

import numpy as np
import pytest

from penode.data.mapping import Origin
from penode.errors import InputError
from penode.pmsm.recording.drive_mapping import RECORDED, DriveMapping, DriveOrigin
from penode.pmsm.study_file import load_study

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


def test_a_column_that_moves_is_one_channel(file):
    channels = {name: origin(name) for name in ("t", "u_d", "u_q", "i_d", "i_q", "omega_el")}
    channels["i_q"] = DriveOrigin(Origin("i_d", "A"))
    words = r"column i_d is mapped to i_d and to i_q; .* \(not used: i_q, theta_el\)"
    with pytest.raises(InputError, match=words):
        DriveMapping(channels).load(file)
    channels["i_q"] = DriveOrigin(Origin("i_d", "A", sign=-1))  # two phases of a line
    assert len(DriveMapping(channels).load(file)) == 20


def untimed(file):
    """Rewrite a file with a counter of samples in place of the times."""
    lines = file.read_text().splitlines()
    rows = [f"{k},{line.split(',', 1)[1]}" for k, line in enumerate(lines[1:])]
    file.write_text("\n".join([lines[0].replace("t,", "count,", 1), *rows]))


def test_even_samples_need_no_column_of_times(file):
    timed = DriveMapping().load(file)
    untimed(file)
    run = DriveMapping(constants={"time_step": 1e-3}).load(file)
    assert run.time_step == pytest.approx(1e-3)
    np.testing.assert_array_equal(
        run.stack(tuple(timed.channels)), timed.stack(tuple(timed.channels))
    )


@pytest.mark.parametrize("named", [False, True])
def test_stamps_that_jitter_are_those_of_a_clock_whose_step_is_given(file, named):
    timed = DriveMapping().load(file)
    lines = file.read_text().splitlines()
    late = 1e-3 * np.random.default_rng(5).uniform(0, 0.9, len(lines))
    rows = [f"{1e-3 * k + late[k]},{line.split(',', 1)[1]}" for k, line in enumerate(lines[1:])]
    file.write_text("\n".join([lines[0].replace("t,", "stamp," if named else "t,", 1), *rows]))
    names = ("t", "u_d", "u_q", "i_d", "i_q", "omega_el")
    channels = {n: origin(n) for n in names} if named else {}
    if named:
        channels["t"] = DriveOrigin(Origin("stamp", "s"))
    with pytest.raises(InputError, match="give its step in s as time_step"):
        DriveMapping(channels).load(file)
    run = DriveMapping(channels, constants={"time_step": 1e-3}).load(file)
    assert run.time_step == pytest.approx(1e-3, rel=1e-9)
    np.testing.assert_array_equal(run.stack(names[1:]), timed.stack(names[1:]))
    with pytest.raises(InputError, match=r"time_step is 0.002 s .* the rows of t are 0.00"):
        DriveMapping(channels, constants={"time_step": 2e-3}).load(file)


def test_the_time_step_of_a_recording_is_none_of_the_points_beside_it(tmp_path):
    table = tmp_path / "points.csv"
    rows = np.random.default_rng(2).normal((0, 0, 0, 0, 300), size=(12, 5))
    np.savetxt(table, rows, delimiter=",", header="u_d,u_q,i_d,i_q,omega_el", comments="")
    (tmp_path / "study.toml").write_text("time_step = 1e-4\n")
    assert len(load_study(tmp_path / "study.toml").load_points(table)) == 12


def at_rest(file, **moving):
    """Rewrite a file without the speed, and without the angle but where it is given."""
    names = ["u_d", "u_q", "i_d", "i_q", *moving]
    table = np.column_stack([1e-3 * np.arange(20), ROWS[:, :4], *moving.values()])
    np.savetxt(file, table, delimiter=",", header=",".join(["t", *names]), comments="")
    return {name: origin(name) for name in ("t", *names)}


def test_a_rotor_that_stood_still_has_a_speed_of_zero_and_no_column(file):
    run = DriveMapping(at_rest(file), constants={"omega_el": 0.0}).load(file)
    assert not run.channels["omega_el"].any()
    assert len(run.channels["omega_el"]) == len(run)


def test_without_a_speed_the_refusal_names_the_entry_of_a_rotor_that_stood_still(file):
    with pytest.raises(InputError, match=r"give omega_el = 0 .*penode init --standstill"):
        DriveMapping(at_rest(file)).load(file)
    voltages = {name: column for name, column in at_rest(file).items() if not name.startswith("i")}
    with pytest.raises(InputError, match="no channel i_d, i_q, omega_el") as refused:
        DriveMapping(voltages).load(file)
    assert "standstill" not in str(refused.value)  # more than the speed is missing


def test_a_speed_that_is_a_number_is_zero_and_no_channel_beside(file):
    channels = {name: origin(name) for name in ("t", "u_d", "u_q", "i_d", "i_q", "omega_el")}
    with pytest.raises(InputError, match="omega_el is a number"):
        DriveMapping(channels, constants={"omega_el": 0.0})
    with pytest.raises(InputError, match="omega_el must be 0, of a rotor that stood still"):
        DriveMapping(at_rest(file), constants={"omega_el": 30.0})


def test_an_angle_that_turns_contradicts_a_rotor_that_stood_still(file):
    channels = at_rest(file, theta_el=np.linspace(0.0, 2.0, 20))
    with pytest.raises(InputError, match=r"omega_el = 0 .*channel theta_el turns"):
        DriveMapping(channels, constants={"omega_el": 0.0}).load(file)
    channels = at_rest(file, theta_el=np.full(20, 2.0))
    run = DriveMapping(channels, constants={"omega_el": 0.0}).load(file)
    assert run.channels["theta_el"][0] == 2.0
