"""Free starts: states at a window's start that the window itself estimates, then eliminates.

The starts are solved to their minimum for every value of the shared parameters, so that the loss is
a function of the shared parameters alone, and its Gauss-Newton terms are the Schur complement of
the joint ones (variable projection after Kaufman 1975, doi:10.1007/BF01932995).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.native.normal_matrix import NormalMatrix
from penode.training.prediction_error import Batch, PredictionError
from penode.training.sensitivities import Sums, along, window_sums

_MOST_PASSES = 30
#: A window has converged when its next step but one, if steps go on shrinking as they did, lowers
#: its squares by no more than this fraction. The next one is made.
_TOLERANCE = 1e-14


class _Search(NamedTuple):
    best: JaxArray
    squares: JaxArray
    slope: JaxArray
    curvature: JaxArray
    damping: JaxArray
    trial: JaxArray
    gain: JaxArray
    passes: JaxArray
    converged: JaxArray


def estimated_starts(
    error: PredictionError, values: JaxArray, horizon: JaxArray, batch: Batch
) -> JaxArray:
    """Return the corrections (free, batch) that minimise each window's squares, SI units.

    Levenberg-Marquardt on every window at once, from the measured start or the first guess, at
    parameters (value, 1) that all windows share.
    """
    free, width = len(error.free), len(batch.starts)
    zero = jnp.zeros((free, width), values.dtype)
    if not free:
        return zero
    stiffness = jnp.asarray(error.stiffness)[:, None]

    def evaluate(correction: JaxArray) -> tuple[JaxArray, JaxArray, JaxArray]:
        nothing = NormalMatrix.zero(0, values)
        sums = window_sums(error, values, correction, horizon, batch, nothing)
        squares = sums.squares + jnp.sum(stiffness * correction**2, axis=0)
        curvature = sums.mixed.own + (np.eye(free)[..., None] * stiffness)
        return squares, sums.scores.own - stiffness * correction, curvature

    def body(at: _Search) -> _Search:
        squares, slope, curvature = evaluate(at.trial)
        better = squares <= at.squares
        best = jnp.where(better, at.trial, at.best)
        slope = jnp.where(better, slope, at.slope)
        curvature = jnp.where(better, curvature, at.curvature)
        damping = jnp.where(better, at.damping / 10, jnp.maximum(at.damping, 1e-6) * 10)
        squares = jnp.minimum(jnp.where(better, squares, jnp.inf), at.squares)
        factor = _factor(curvature, damping)
        halfway = _forward(factor, slope[:, None])
        gain, step = jnp.sum(halfway**2, axis=(0, 1)), _backward(factor, halfway)[:, 0]
        stuck = ~(damping < 1e12)
        trial = best + jnp.where(stuck, 0.0, step)
        last = better & (gain**2 <= _TOLERANCE * squares * at.gain)
        converged = stuck | last | (gain <= _TOLERANCE * squares)
        return _Search(
            best, squares, slope, curvature, damping, trial, gain, at.passes + 1, converged
        )

    def unfinished(at: _Search) -> JaxArray:
        return (at.passes < _MOST_PASSES) & ~jnp.all(at.converged)

    blank = jnp.ones((free, free, width), values.dtype)
    never = jnp.full(width, jnp.inf, values.dtype)
    start = _Search(
        zero,
        never,
        zero,
        blank,
        jnp.full(width, 1e-6, values.dtype),
        zero,
        jnp.zeros(width, values.dtype),
        jnp.zeros((), int),
        never < 0,
    )
    found = jax.lax.while_loop(unfinished, body, start)
    return jnp.where(found.converged, found.trial, found.best)


def eliminated(
    error: PredictionError, sums: Sums, correction: JaxArray, used: JaxArray
) -> tuple[JaxArray, JaxArray, NormalMatrix]:
    """Return squares (batch,), scores (value, batch) and normal matrix without the starts.

    The corrections' own squares are included, and what is left of them to the minimum is taken off.
    """
    free = len(error.free)
    if not free:
        return sums.squares, sums.scores.shared, sums.normal
    stiffness = jnp.asarray(error.stiffness)[:, None]
    squares = sums.squares + used * jnp.sum(stiffness * correction**2, axis=0)
    slope = sums.scores.own - used * stiffness * correction
    curvature = sums.mixed.own + np.eye(free)[..., None] * stiffness
    curvature = jnp.where(used > 0, curvature, np.eye(free)[..., None])
    factor = _factor(curvature, 0.0 * used)
    shared, own = _forward(factor, sums.mixed.shared), _forward(factor, slope[:, None])[:, 0]
    scores = sums.scores.shared - along(own, shared)
    return squares - jnp.sum(own**2, axis=0), scores, sums.normal.minus(shared)


def _factor(curvature: JaxArray, damping: JaxArray) -> list[list[JaxArray]]:
    """Return Cholesky's lower factor of curvature + damping diagonal, its entries (batch,)."""
    free = len(curvature)
    diagonal = jnp.einsum("iib->ib", curvature)
    floor = 1e-30 + 1e-13 * jnp.max(diagonal, axis=0)
    factor: list[list[JaxArray]] = []
    for i in range(free):
        row: list[JaxArray] = []
        for j in range(i):
            row.append((curvature[i, j] - along(row, factor[j])) / factor[j][j])
        left = diagonal[i] * (1.0 + damping) + floor - along(row, row)
        factor.append([*row, jnp.sqrt(jnp.maximum(left, floor))])
    return factor


def _forward(factor: list[list[JaxArray]], right: JaxArray) -> JaxArray:
    """Solve L y = right for every window, shape (free, k, batch)."""
    rows: list[JaxArray] = []
    for i, row in enumerate(factor):
        rows.append((right[i] - along(row[:i], rows)) / row[i])
    return jnp.stack(rows)


def _backward(factor: list[list[JaxArray]], right: JaxArray) -> JaxArray:
    """Solve L' x = right for every window, shape (free, k, batch)."""
    rows: list[JaxArray] = []
    for i in reversed(range(len(factor))):
        column = [factor[k][i] for k in range(len(factor) - 1, i, -1)]
        rows.append((right[i] - along(column, rows)) / factor[i][i])
    return jnp.stack(rows[::-1])
