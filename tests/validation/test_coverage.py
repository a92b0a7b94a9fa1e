"""The excited region: near what was visited, whatever the units."""

import numpy as np
import pytest

from penode.validation.coverage import supported, thin

UNITS = pytest.mark.parametrize("unit", [np.array([1.0, 1.0]), np.array([1e-3, 1e5])], ids=str)


@UNITS
def test_gaps_up_to_a_fifth_of_the_range_are_bridged_and_the_outside_is_not(unit):
    """States on a circle of radius 1; shares are of its diameter."""
    angle = np.linspace(0, 2 * np.pi, 400)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) * unit
    reach = np.array([0.0, 0.79, 0.81, 1.0, 1.03, 1.05, 3.0])
    expected = [False, False, True, True, True, False, False]
    for direction in ([1.0, 0.0], [0.0, -1.0], [0.6, 0.8]):
        points = reach[:, None] * np.array(direction) * unit
        np.testing.assert_array_equal(supported(circle, points), expected)


@UNITS
def test_the_gap_between_two_clusters_is_not_supported(unit, rng):
    cluster = 0.05 * rng.uniform(-1, 1, (50, 2))
    visited = np.concatenate([cluster, cluster + 1.0]) * unit
    points = np.array([[0.0, 0.0], [0.5, 0.5], [1.0, 1.0], [1.0, 0.0]]) * unit
    np.testing.assert_array_equal(supported(visited, points), [True, False, True, False])


def test_every_visited_state_is_supported(rng):
    visited = rng.normal(size=(500, 3)) * [1.0, 1e6, 1e-6]
    assert supported(visited, visited).all()


def test_one_state_is_an_interval_with_gaps():
    visited = np.array([[0.0], [0.1], [0.2], [0.9], [1.0]])
    points = np.array([[-0.03], [-0.01], [0.15], [0.29], [0.31], [0.95], [1.01], [1.03]])
    expected = [False, True, True, True, False, True, True, False]
    np.testing.assert_array_equal(supported(visited, points), expected)


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
