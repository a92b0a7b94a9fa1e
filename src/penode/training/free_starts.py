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
from penode.training.sensitivities import Sums, window_sums

_MOST_PASSES = 30
#: A window has converged when its next step can lower its squares by no more than this fraction.
_TOLERANCE = 1e-14


class _Search(NamedTuple):
    best: JaxArray
    squares: JaxArray
    slope: JaxArray
    curvature: JaxArray
    damping: JaxArray
    trial: JaxArray
    passes: JaxArray
    converged: JaxArray


def estimated_starts(
    error: PredictionError, values: JaxArray, horizon: JaxArray, batch: Batch
) -> JaxArray:
    """Return the corrections (free, batch) that minimise each window's squares, SI units.

    Levenberg-Marquardt on every window at once, from the measured start or the first guess.
    """
    free, width = len(error.free), values.shape[1]
    zero = jnp.zeros((free, width), values.dtype)
    if not free:
        return zero
    stiffness = jnp.asarray(error.stiffness)[:, None]

    def evaluate(correction: JaxArray) -> tuple[JaxArray, JaxArray, JaxArray]:
        nothing = NormalMatrix.zero(0, values)
        sums = window_sums(error, values, correction, horizon, batch, nothing)
        squares = sums.squares + jnp.sum(stiffness * correction**2, axis=0)
        curvature = sums.own + (np.eye(free)[..., None] * stiffness)
        return squares, sums.scores - stiffness * correction, curvature

    def body(at: _Search) -> _Search:
        squares, slope, curvature = evaluate(at.trial)
        better = squares <= at.squares
        best = jnp.where(better, at.trial, at.best)
        slope = jnp.where(better, slope, at.slope)
        curvature = jnp.where(better, curvature, at.curvature)
        damping = jnp.where(better, at.damping / 10, jnp.maximum(at.damping, 1e-6) * 10)
        squares = jnp.minimum(jnp.where(better, squares, jnp.inf), at.squares)
        step = _solve(curvature, slope[:, None], damping)[:, 0]
        gain = jnp.sum(step * slope, axis=0)
        converged = (gain <= _TOLERANCE * squares) | ~(damping < 1e12)
        trial = best + jnp.where(converged, 0.0, step)
        return _Search(best, squares, slope, curvature, damping, trial, at.passes + 1, converged)

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
        jnp.zeros((), int),
        never < 0,
    )
    return jax.lax.while_loop(unfinished, body, start).best


def eliminated(
    error: PredictionError, sums: Sums, correction: JaxArray, used: JaxArray
) -> tuple[JaxArray, JaxArray, NormalMatrix]:
    """Return squares (batch,), scores (value, batch) and normal matrix without the starts.

    The corrections' own squares are included.
    """
    free = len(error.free)
    if not free:
        return sums.squares, sums.scores, sums.normal
    lead = len(sums.normal.lower)
    stiffness = jnp.asarray(error.stiffness)[:, None]
    squares = sums.squares + used * jnp.sum(stiffness * correction**2, axis=0)
    slope = sums.scores[lead:] - used * stiffness * correction
    curvature = sums.own[:, lead:] + np.eye(free)[..., None] * stiffness
    curvature = jnp.where(used > 0, curvature, np.eye(free)[..., None])
    mixed = sums.own[:, :lead]
    removed = _solve(curvature, jnp.concatenate([mixed, slope[:, None]], axis=1), 0.0 * used)
    scores = sums.scores[:lead] - jnp.sum(mixed * removed[:, -1:], axis=0)
    normal = sums.normal.minus(jnp.einsum("fib,fjb->ij", mixed, removed[:, :-1]))
    return squares, scores, normal


def _solve(curvature: JaxArray, right: JaxArray, damping: JaxArray) -> JaxArray:
    """Solve (curvature + damping diagonal) x = right for every window, shape (free, k, batch)."""
    free = len(curvature)
    diagonal = jnp.einsum("iib->ib", curvature)
    floor = 1e-30 + 1e-13 * jnp.max(diagonal, axis=0)
    damped = curvature + np.eye(free)[..., None] * (damping * diagonal + floor)
    if free == 1:
        return right / damped[:, 0][:, None]
    solution = jnp.linalg.solve(jnp.moveaxis(damped, -1, 0), jnp.moveaxis(right, -1, 0))
    return jnp.moveaxis(solution, 0, -1)
