"""A second map in the report: its difference and both sets of contours, where both are known."""

from dataclasses import replace

import numpy as np
import pytest

from penode.errors import InputError
from penode.pmsm.machine.flux_grid import tabulate
from penode.pmsm.report.against import Against
from penode.pmsm.report.flux_sections import current_grid
from penode.report.document import Figure
from penode.report.fit_report import Page


def shifted(grid, d, q):
    """Return a table whose flux linkage differs by a plane in the currents, Vs."""
    i_d, i_q = grid.mesh
    return replace(grid, psi=grid.psi + np.stack([d + 2e-6 * i_d, q - 1e-6 * i_q]))


def test_the_difference_and_both_maps_are_drawn_in_millivolt_seconds(machine_fit):
    other = shifted(tabulate(machine_fit, 31), 1e-3, 2e-3)
    section = Against.of(machine_fit, "fem.csv", other).second_map(machine_fit)
    difference, both = section.blocks
    assert isinstance(difference, Figure)
    assert isinstance(both, Figure)
    assert "Psi differs by" in difference.title
    grid = current_grid(machine_fit, 121)
    i_d, i_q = grid.mesh
    expected = np.stack([1 + 2e-3 * i_d, 2 - 1e-3 * i_q])
    shades = [t for t in difference.plot.data if t.type == "contour" and t.hovertemplate]
    for trace, values in zip(shades, expected, strict=True):
        drawn = np.asarray(trace.z, dtype=float)
        known = np.isfinite(drawn) & grid.supported
        assert known.sum() > 0.6 * grid.supported.sum()
        np.testing.assert_allclose(drawn[known], values[known], atol=1e-6)
    orange = both.plot.data[-2:]
    psi = 1e3 * machine_fit.flux_map(*grid.mesh) + expected
    for trace, values in zip(orange, psi, strict=True):
        known = np.isfinite(trace.z)
        assert not (known & ~grid.supported).any()
        np.testing.assert_allclose(trace.z[known], values[known], atol=1e-6)


def test_another_fit_brings_its_resistance(machine_fit):
    section = Against.of(machine_fit, "warm", machine_fit).second_map(machine_fit)
    assert "they agree" in section.lead
    assert len(section.blocks) == 2


def test_maps_without_common_currents_are_refused(machine_fit):
    grid = tabulate(machine_fit, 11)
    with pytest.raises(InputError, match="no current is supported"):
        Against.of(machine_fit, "fem.csv", replace(grid, supported=~np.ones_like(grid.supported)))


def test_the_section_is_a_part_of_a_page(machine_fit):
    other = shifted(tabulate(machine_fit, 21), 0.0, 0.0)
    page = Page(parts=(Against.of(machine_fit, "fem.csv", other).second_map,))
    titles = [one.title for one in page.document(machine_fit).sections]
    assert titles == ["Against another map"]
