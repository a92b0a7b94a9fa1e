"""What is found of a flux map that is known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from penode.bench.flux_table import FluxTable
from penode.bench.map_checks import cell_inductance, check_map
from penode.errors import InputError

#: H: not reciprocal by 2e-5, and with cross terms that no symmetric machine has.
INDUCTANCE = np.array([[2e-4, 5e-5], [3e-5, 4e-4]])
OFFSET = np.array([0.05, 0.002])


def table_of(i_d, i_q, inductance=INDUCTANCE, offset=OFFSET):
    """Return the linear map at currents (row, column), at one angle."""
    psi = np.tensordot(inductance, np.stack([i_d, i_q]), 1) + offset[:, None, None]
    return FluxTable("map", i_d, i_q, np.zeros(1), psi[0][..., None], psi[1][..., None])


def straight():
    axes = np.linspace(-100.0, 20.0, 9), np.linspace(-60.0, 60.0, 7)
    return np.meshgrid(*axes, indexing="ij")


def polar():
    """Currents by length and angle, which turn against each other from row to row."""
    length, angle = np.meshgrid(np.linspace(10, 100, 6), np.linspace(0.2, 2.8, 9), indexing="ij")
    return length * np.cos(angle), length * np.sin(angle)


@pytest.mark.parametrize("grid", [straight, polar])
def test_a_linear_map_has_its_inductance_in_every_cell_of_any_grid(grid):
    inductance, cells = cell_inductance(table_of(*grid()))
    assert cells.all()
    expected = np.broadcast_to(INDUCTANCE, inductance.shape)
    np.testing.assert_allclose(inductance, expected, rtol=1e-9)


def test_reciprocity_and_ranges_are_those_of_the_map():
    found = check_map(table_of(*straight()))
    assert found.reciprocity_residual == pytest.approx(2e-5)
    assert (found.covered_share, found.i_d_range, found.i_q_range) == (1, (-100, 20), (-60, 60))


def test_asymmetry_is_what_changes_sign_with_the_mirror():
    """psi_d must be even in i_q and psi_q odd; what is not counts twice at the points off zero."""
    i_d, i_q = straight()
    loaded = i_q != 0
    odd_d = 2 * INDUCTANCE[0, 1] * i_q[loaded]
    even_q = 2 * (OFFSET[1] + INDUCTANCE[1, 0] * i_d[loaded])
    expected = np.sqrt(np.mean(np.stack([odd_d, even_q]) ** 2))
    assert check_map(table_of(i_d, i_q)).asymmetry == pytest.approx(expected)
    symmetric = table_of(i_d, i_q, np.diag([2e-4, 4e-4]), np.array([0.05, 0.0]))
    assert check_map(symmetric).asymmetry == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(("high_q", "judged"), [(180.0, True), (200.0, False)])
def test_symmetry_is_judged_where_a_fifth_of_the_currents_have_a_mirror_image(high_q, judged):
    """The columns at -20 A and 20 A do, of ten columns or of eleven."""
    i_d, i_q = np.meshgrid(np.linspace(-100.0, 20.0, 9), np.arange(-20.0, high_q + 1.0, 20.0))
    assert (check_map(table_of(i_d, i_q)).asymmetry is not None) == judged


def without(table, chosen):
    psi_d = np.where(chosen[..., None], np.nan, table.psi_d)
    return replace(table, psi_d=psi_d)


def test_a_corner_may_be_missing_and_is_left_out_of_the_ranges():
    table = table_of(*straight())
    found = check_map(without(table, table.i_d < -90.0))
    assert found.covered_share == pytest.approx(8 / 9)
    assert found.i_d_range == (-85.0, 20.0)
    assert found.reciprocity_residual == pytest.approx(2e-5)


def test_a_hole_is_refused_with_its_place():
    table = table_of(*straight())
    hole = (table.i_d == -40.0) & (table.i_q >= 0.0) & (table.i_q <= 20.0)
    with pytest.raises(InputError, match=r"map: 2 points .* first at i_d = -40 A, i_q = 0 A"):
        check_map(without(table, hole))
    with pytest.raises(InputError, match="no point of the map has values"):
        check_map(without(table, table.i_d < 99.0))


@pytest.mark.parametrize("inductance", [-INDUCTANCE, INDUCTANCE * [[1, 1], [1, -1]]])
def test_fluxes_that_fall_with_their_current_are_refused(inductance):
    """Of the other sign convention both fall, and the determinant alone is above zero."""
    with pytest.raises(InputError, match="cannot be inverted in 48 of 48 cells"):
        check_map(table_of(*straight(), inductance))
