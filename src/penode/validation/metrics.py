"""Scalar measures of prediction error."""

import numpy as np

from penode.arrays import FloatArray

#: Two-sided 95 % point of the normal distribution.
NORMAL_95 = 1.96


def rmse(measured: FloatArray, predicted: FloatArray) -> float:
    """Return the root mean squared difference of two arrays; infinite where it is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        value = float(np.sqrt(np.mean((measured - predicted) ** 2)))
    return value if np.isfinite(value) else float("inf")
