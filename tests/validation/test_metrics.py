"""Scalar measures on hand-made errors."""

import numpy as np
import pytest

from penode.validation.metrics import rmse


def test_rmse_is_over_all_entries():
    measured = np.array([[1.0, 2.0], [3.0, 4.0]])
    assert rmse(measured, measured) == 0.0
    assert rmse(measured, measured + np.diag([3.0, 4.0])) == pytest.approx(2.5)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf, 1e200])
def test_rmse_is_infinite_where_a_prediction_is_lost(broken, recwarn):
    assert rmse(np.zeros(3), np.array([0.0, broken, 0.0])) == np.inf
    assert not recwarn.list
