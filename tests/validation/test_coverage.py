"""The excited region: near what was visited, whatever the units."""

import numpy as np
import pytest

from penode.validation.coverage import supported, thin


@pytest.mark.parametrize("unit", [np.array([1.0, 1.0]), np.array([1e-3, 1e5])])
def test_points_within_six_percent_of_the_range_are_supported(unit):
    visited = np.array([[0.0, 0.0], [10.0, 100.0], [5.0, 0.0]]) * unit
    points = np.array(
        [[0.0, 0.0], [5.59, 0.0], [5.61, 0.0], [5.0, 5.9], [5.0, 6.1], [2.5, 0.0], [-9.0, 0.0]]
    )
    expected = [True, True, False, True, False, False, False]
    np.testing.assert_array_equal(supported(visited, points * unit), expected)


def test_every_visited_state_is_supported(rng):
    visited = rng.normal(size=(500, 3)) * [1.0, 1e6, 1e-6]
    assert supported(visited, visited).all()


def test_a_hole_in_the_middle_is_not_supported():
    angle = np.linspace(0, 2 * np.pi, 200)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_array_equal(
        supported(ring, np.array([[0.0, 0.0], [0.9, 0.0]])), [False, True]
    )


def test_a_state_that_never_moves_does_not_divide_by_zero():
    visited = np.stack([np.linspace(0, 1, 50), np.full(50, 7.0)], axis=1)
    points = np.array([[0.5, 7.0], [0.5, 8.0]])
    np.testing.assert_array_equal(supported(visited, points), [True, False])


@pytest.mark.parametrize(("rows", "most", "kept"), [(10, 20, 10), (20, 20, 20), (21, 20, 11)])
def test_thinning_keeps_evenly_spaced_rows(rows, most, kept):
    states = np.arange(2.0 * rows).reshape(rows, 2)
    found = thin(states, most)
    assert len(found) == kept <= most
    np.testing.assert_array_equal(found[0], states[0])
    assert len(np.unique(np.diff(found[:, 0]))) == 1
