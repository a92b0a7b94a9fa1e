"""Which states the recordings have visited."""

import numpy as np
from scipy.spatial import cKDTree

from penode.arrays import BoolArray, FloatArray

#: A point is supported when a visited state lies within this share of the visited range.
_REACH = 0.06


def thin(states: FloatArray, most: int = 2000) -> FloatArray:
    """Return at most `most` evenly spaced rows of states (time, state)."""
    return states[:: max(-(-len(states) // most), 1)]


def supported(visited: FloatArray, points: FloatArray) -> BoolArray:
    """Return which points lie in the excited region.

    Parameters
    ----------
    visited : ndarray, shape (sample, state)
        States of the recordings.
    points : ndarray, shape (point, state)
        States to judge.

    Returns
    -------
    ndarray of bool, shape (point,)
        True within 6 % of the visited range of a visited state.
    """
    span = np.ptp(visited, axis=0)
    span = np.where(span > 0, span, 1.0)
    distance, _ = cKDTree(visited / span).query(points / span)
    return np.asarray(distance <= _REACH)
