"""Which states the recordings have visited."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from penode.arrays import BoolArray, FloatArray

#: A supported point has a visited state within this fraction of the visited range, and lies no
#: further than a fifth of that outside the hull of all visited states.
_REACH = 0.1


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
        True between visited states that are close enough, each coordinate measured in fractions of
        its visited range: gaps up to a fifth of the range are bridged, the outside is not.
    """
    span = np.ptp(visited, axis=0)
    span = np.where(span > 0, span, 1.0)
    distance, _ = cKDTree(visited / span).query(points / span)
    return np.asarray(
        (distance <= _REACH) & (_outside(visited / span, points / span) <= _REACH / 5)
    )


def _outside(visited: FloatArray, points: FloatArray) -> FloatArray:
    """Return how far points (point, state) lie beyond the hull of the visited states."""
    if visited.shape[1] == 1:
        beyond = np.maximum(visited.min() - points, points - visited.max())
        return np.asarray(beyond[:, 0])
    try:
        faces = ConvexHull(visited).equations
    except QhullError:  # fewer states than dimensions, or all on a line: distance alone decides
        return np.zeros(len(points))
    return np.asarray((points @ faces[:, :-1].T + faces[:, -1]).max(axis=1))
