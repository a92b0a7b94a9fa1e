"""The table of a flux map: zero among its currents, its mask, and files read back."""

from dataclasses import replace

import numpy as np
import pytest

from penode.errors import InputError
from penode.fit.outcome import Estimate
from penode.pmsm.machine.flux_grid import even_axis, interpolation_error, read_grid, tabulate
from penode.pmsm.result_files import flux_map_csv


@pytest.mark.parametrize(
    ("low", "high"), [(-300.0, 20.0), (-0.1, 250.0), (0.0, 100.0), (-70.0, 0.0), (-33.3, 77.7)]
)
def test_axis_covers_the_range_with_zero_exactly_among_even_points(low, high):
    axis = even_axis(low, high, 41)
    assert len(axis) == 41
    assert np.count_nonzero(axis == 0.0) == 1
    np.testing.assert_allclose(np.diff(axis), axis[1] - axis[0], rtol=1e-12)
    assert axis[0] <= low
    assert axis[-1] >= high
    assert np.ptp(axis) <= (high - low) * 41 / 38, "widened by less than two steps"


def test_table_holds_the_fits_map_and_where_it_is_supported(machine_fit):
    grid = tabulate(machine_fit, 31)
    i_d, i_q = grid.mesh
    np.testing.assert_array_equal(grid.psi, machine_fit.flux_map(i_d, i_q))
    np.testing.assert_array_equal(grid.inductance, machine_fit.differential_inductance(i_d, i_q))
    reach = np.hypot(i_d, i_q)
    assert grid.supported[(reach < 290) & (i_d < 145)].all()
    assert not grid.supported[reach > 315].any()
    assert grid.pole_pairs == 5
    assert grid.dead_time_voltage is None
    assert tabulate(machine_fit, 31, pole_pairs=3).pole_pairs == 3
    torque = 1.5 * 5 * (grid.psi[0] * i_q - grid.psi[1] * i_d)
    np.testing.assert_allclose(grid.torque, torque, rtol=1e-12)


def test_the_dead_time_is_that_of_a_fit_that_answers(machine_fit):
    dead_time = Estimate.of(4.0, 0.1, "V")
    parameters = {**machine_fit.parameters, "dead_time_voltage": dead_time}
    behind = replace(machine_fit, parameters=parameters)
    assert tabulate(behind, 5).dead_time_voltage == 4.0
    lost = replace(behind, horizon=replace(behind.horizon, verdict="no plateau"))
    assert tabulate(lost, 5).dead_time_voltage is None


def test_splines_of_the_table_follow_the_fit(machine_fit, rng):
    grid = tabulate(machine_fit, 41)
    points = rng.uniform(-140, 140, (2, 200))
    largest = np.abs(grid.psi).max()
    error = grid.flux_map(*points) - machine_fit.flux_map(*points)
    assert np.abs(error).max() < 1e-5 * largest
    inductance = machine_fit.differential_inductance(*points)
    error = grid.differential_inductance(*points) - inductance
    assert np.abs(error).max() < 1e-3 * inductance.max()


def test_error_of_linear_interpolation_falls_with_the_square_of_the_step(machine_fit):
    coarse, fine = (interpolation_error(machine_fit, tabulate(machine_fit, n)) for n in (21, 41))
    assert 3 < coarse / fine < 5


def test_resistance_that_the_recordings_cannot_tell_is_left_out(machine_fit):
    lost = replace(machine_fit, horizon=replace(machine_fit.horizon, verdict="no plateau"))
    grid = tabulate(lost, 5)
    assert grid.resistance is None
    assert grid.temperatures.of_map.startswith("The verdict is 'no plateau': R is left out")
    assert "verdict" not in tabulate(machine_fit, 5).temperatures.of_map
    assert tabulate(machine_fit, 5).resistance == 0.01


def test_refusals(machine_fit):
    with pytest.raises(InputError, match="must be >= 5"):
        tabulate(machine_fit, 4)
    with pytest.raises(InputError, match="pole_pairs must be >= 1, got 0"):
        tabulate(machine_fit, 5, pole_pairs=0)
    flat = replace(machine_fit, excited=machine_fit.excited * [0, 1])
    with pytest.raises(InputError, match="i_d or i_q at zero"):
        tabulate(flat, 11)


def test_flux_map_csv_reads_back(machine_fit, tmp_path):
    path = tmp_path / "flux_map.csv"
    path.write_text(flux_map_csv(machine_fit))
    grid = read_grid(path)
    np.testing.assert_allclose(grid.psi, machine_fit.flux_map(*grid.mesh), rtol=1e-7, atol=1e-9)
    points = grid.mesh.reshape(2, -1).T
    np.testing.assert_array_equal(grid.supported.ravel(), machine_fit.supported(points))


def test_points_that_a_file_leaves_out_are_not_supported(tmp_path):
    axis = np.linspace(-10, 10, 7)
    i_d, i_q = (one.ravel() for one in np.meshgrid(axis, axis))
    inside = np.hypot(i_d, i_q) < 11
    rows = np.column_stack([i_d, i_q, 0.1 + i_d, i_q])[inside]
    path = tmp_path / "map.csv"
    np.savetxt(path, rows, delimiter=",", header="i_d,i_q,psi_d,psi_q", comments="")
    grid = read_grid(path)
    assert np.count_nonzero(grid.supported) == np.count_nonzero(inside)
    np.testing.assert_array_equal(np.isfinite(grid.psi[0]), grid.supported)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("i_d,psi_d\n1,2\n", "i_q, psi_q"),
        ("i_d,i_q,psi_d,psi_q\n1,2,3,4\n", "on a grid"),
        ("i_d,i_q,psi_d,psi_q\n1,2,x,4\n", "text"),
        ("i_d,i_q,psi_d,psi_q\n1,2,3,4\n1,,3,4\n", "a current is missing"),
        ("", "cannot be read"),
    ],
)
def test_files_that_are_no_map_are_refused(tmp_path, text, words):
    path = tmp_path / "map.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_grid(path)
    with pytest.raises(InputError, match="there is no such file"):
        read_grid(tmp_path / "absent.csv")
