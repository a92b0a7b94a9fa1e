"""Newton's method at many points at once."""

import numpy as np

from penode.pmsm.control.inversion import inverse, solved


def cubic(x):
    return np.stack([x[0] + x[0] ** 3 + 0.1 * x[1], x[1] + x[1] ** 3 + 0.1 * x[0]])


def cubic_slope(x):
    cross = np.full_like(x[0], 0.1)
    return np.stack([np.stack([1 + 3 * x[0] ** 2, cross]), np.stack([cross, 1 + 3 * x[1] ** 2])])


def test_values_are_taken_at_what_was_found(rng):
    targets = rng.normal(size=(2, 50))
    found = inverse(cubic, cubic_slope, targets, targets.copy())
    np.testing.assert_allclose(cubic(found), targets, atol=1e-12)


def test_a_value_that_is_never_taken_is_not_found():
    targets = np.array([[1.0, -1.0], [1.0, 1.0]])
    found = inverse(
        lambda x: x**2,
        lambda x: 2 * np.stack([[x[0], 0 * x[0]], [0 * x[1], x[1]]]),
        targets,
        np.full((2, 2), 0.7),
    )
    np.testing.assert_allclose(found[:, 0], 1.0)
    assert np.isnan(found[:, 1]).all()


def test_singular_systems_have_no_solution(rng):
    matrix = rng.normal(size=(2, 2, 3))
    matrix[1, :, 1] = 2 * matrix[0, :, 1]
    vector = rng.normal(size=(2, 3))
    solution = solved(matrix, vector)
    assert np.isnan(solution[:, 1]).all()
    for k in (0, 2):
        np.testing.assert_allclose(matrix[:, :, k] @ solution[:, k], vector[:, k])
