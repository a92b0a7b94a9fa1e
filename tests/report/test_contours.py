"""Contours: round levels, and labels that stand inside the region on their lines."""

import numpy as np
import pytest

from penode.report.region_map import label_places, nice_levels


@pytest.mark.parametrize(
    "values", [[3.0, 97.0], [-0.4, 0.4], [2.0, 2.0], [0.0, 0.0], [-1e-9, 5e-9], [449.9, 450.1]]
)
def test_levels_cover_the_values_at_round_numbers(values):
    levels = nice_levels(np.array(values), 10)
    step = levels[1] - levels[0]
    assert levels[0] <= min(values) + 1e-9 * step
    assert levels[-1] >= max(values) - 1e-9 * step
    assert 2 <= len(levels) <= 16
    mantissa = step / 10 ** np.floor(np.log10(step) + 1e-9)
    assert np.isclose(mantissa, [1, 2, 5]).any()


def test_labels_stand_inside_the_region_on_their_line():
    y, x = np.mgrid[-1:1:81j, -1:1:81j]
    supported = np.hypot(x, y) < 0.9
    levels = np.array([-0.5, 0.0, 0.5])
    places = label_places(x, supported, levels)
    assert places[:, 2].tolist() == [0, 1, 2]
    for row, column, number in places:
        assert np.hypot(x[row, column], y[row, column]) < 0.75
        assert abs(x[row, column] - levels[number]) < 0.05


def test_both_branches_of_a_line_are_labelled_and_apart():
    _, x = np.mgrid[-1:1:81j, -1:1:81j]
    places = label_places(x**2, np.ones(x.shape, dtype=bool), np.array([0.25]))
    assert sorted(np.round(x[places[:, 0], places[:, 1]], 1)) == [-0.5, 0.5]


def test_lines_at_the_rim_get_no_label():
    _, x = np.mgrid[-1:1:81j, -1:1:81j]
    assert label_places(x, np.ones(x.shape, dtype=bool), np.array([0.99])).shape == (0, 3)
