"""Free starts: states at a window's start that the window itself estimates, then eliminates.

The starts are solved to their minimum for every value of the shared parameters, so that the loss is
a function of the shared parameters alone, and its Gauss-Newton terms are the Schur complement of
the joint ones (variable projection after Kaufman 1975, doi:10.1007/BF01932995).
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.native.normal_matrix import NormalMatrix
from penode.training.prediction_error import Batch, PredictionError
from penode.training.sensitivities import Sums, along, window_sums

#: Passes over the windows that look for their starts, where the first step is not enough; of noise
#: with outliers, whose steps shrink by a factor only.
_MOST_PASSES, _MOST_REWEIGHTED = 10, 30
#: A window's start is settled when its next step but one, if steps go on shrinking as they did,
#: lowers its squares by no more than this fraction. The next one is made.
_TOLERANCE = 1e-12
#: The first step is enough where what is taken off beside it is this exact, as a fraction of a
#: window's squares: Newton's step with Gauss's curvature is off by the ratio of two of its steps.
_ACCEPTED = 1e-6
#: Steps shrink where the second promises less than this fraction of what the first did.
_SHRINKING = 0.25
#: Free starts up to which factors are written out.
_WRITTEN_OUT = 8


class _Search(NamedTuple):
    best: JaxArray
    squares: JaxArray
    slope: JaxArray
    curvature: JaxArray
    damping: JaxArray
    trial: JaxArray
    gain: JaxArray
    passes: JaxArray
    settled: JaxArray


class _Terms(NamedTuple):
    attempts: JaxArray
    settled: JaxArray
    squares: JaxArray
    scores: JaxArray
    normal: NormalMatrix
    correction: JaxArray
    # From where the starts are looked for next, (free, batch).
    begin: JaxArray


def sums_without_starts(
    error: PredictionError,
    values: JaxArray,
    horizon: JaxArray,
    batch: Batch,
    normal: NormalMatrix,
    guess: JaxArray,
) -> tuple[JaxArray, JaxArray, NormalMatrix, JaxArray, JaxArray]:
    """Return squares (batch,), scores (value, batch) and normal matrix, the starts eliminated.

    Behind them are the starts' corrections (free, batch), SI units, looked for from a guess of
    them, and how often. The pass that sums them shows as well what is left of each start's way to
    its minimum, and takes it off. Mostly one step before it is enough; where it is not, the starts
    are looked for first. Values are (value, 1); S'S is added to `normal`.
    """
    width = len(batch.starts)
    each = jnp.broadcast_to(values, (len(values), width))
    if not len(error.free):
        sums = window_sums(error, each, guess, horizon, batch, normal)
        return sums.squares, sums.scores.shared, sums.normal, guess, jnp.ones((), int)

    def attempt(before: _Terms) -> _Terms:
        most = jnp.where(before.attempts == 0, 1, _most_passes(error))
        correction, gain = _searched(error, values, horizon, batch, most, before.begin)
        sums = window_sums(error, each, correction, horizon, batch, normal)
        squares, slope, curvature = _with_stiffness(error, sums, correction, batch.used)
        factor = _Factor.of(curvature, 0.0 * gain)
        shared, own = factor.forward(sums.mixed.shared), factor.forward(slope[:, None])[:, 0]
        left = jnp.sum(own**2, axis=0)
        at_minimum = correction + factor.backward(own[:, None])[:, 0]
        return _Terms(
            before.attempts + 1,
            jnp.all(left**1.5 <= _ACCEPTED * squares * gain**0.5),
            squares - left,
            sums.scores.shared - along(own, shared),
            sums.normal.minus(shared),
            at_minimum,
            jnp.where(left < _SHRINKING * gain, at_minimum, guess),
        )

    def unsettled(at: _Terms) -> JaxArray:
        return (at.attempts == 0) | ((at.attempts == 1) & ~at.settled)

    zero = jnp.zeros(width, values.dtype)
    start = _Terms(jnp.zeros((), int), jnp.zeros((), bool), zero, 0.0 * each, normal, guess, guess)
    found = jax.lax.while_loop(unsettled, attempt, start)
    return found.squares, found.scores, found.normal, found.correction, found.attempts


def estimated_starts(
    error: PredictionError, values: JaxArray, horizon: JaxArray, batch: Batch
) -> JaxArray:
    """Return the corrections (free, batch) that minimise each window's squares, SI units.

    Levenberg-Marquardt on every window at once, from the measured start or the first guess, at
    parameters (value, 1) that all windows share.
    """
    nowhere = jnp.zeros((len(error.free), len(batch.starts)), values.dtype)
    if not len(error.free):
        return nowhere
    return _searched(error, values, horizon, batch, jnp.asarray(_most_passes(error)), nowhere)[0]


def followed_by(
    error: PredictionError,
    values: JaxArray,
    correction: JaxArray,
    horizon: JaxArray,
    batch: Batch,
    normal: NormalMatrix,
) -> JaxArray:
    """Return what each start at its minimum shrinks by as a value grows, (free, value, batch).

    Corrections are (free, batch), SI units; values are (value, 1).
    """
    width = len(batch.starts)
    each = jnp.broadcast_to(values, (len(values), width))
    if not len(error.free):
        return jnp.zeros((0, len(values), width), values.dtype)
    sums = window_sums(error, each, correction, horizon, batch, normal)
    _, _, curvature = _with_stiffness(error, sums, correction, batch.used)
    factor = _Factor.of(curvature, jnp.zeros(width, values.dtype))
    return factor.backward(factor.forward(sums.mixed.shared))


def _most_passes(error: PredictionError) -> int:
    return _MOST_PASSES if error.loss.noise is None else _MOST_REWEIGHTED


def _searched(
    error: PredictionError,
    values: JaxArray,
    horizon: JaxArray,
    batch: Batch,
    most: JaxArray,
    guess: JaxArray,
) -> tuple[JaxArray, JaxArray]:
    """Return corrections after so many passes at most, and what the last step promised."""
    free, width = guess.shape

    def body(at: _Search) -> _Search:
        nothing = NormalMatrix.zero(0, values)
        sums = window_sums(error, values, at.trial, horizon, batch, nothing)
        squares, slope, curvature = _with_stiffness(error, sums, at.trial, batch.used)
        better = squares <= at.squares
        best = jnp.where(better, at.trial, at.best)
        slope = jnp.where(better, slope, at.slope)
        curvature = jnp.where(better, curvature, at.curvature)
        damping = jnp.where(better, at.damping / 10, jnp.maximum(at.damping, 1e-6) * 10)
        squares = jnp.minimum(jnp.where(better, squares, jnp.inf), at.squares)
        factor = _Factor.of(curvature, damping)
        halfway = factor.forward(slope[:, None])
        gain, step = jnp.sum(halfway**2, axis=(0, 1)), factor.backward(halfway)[:, 0]
        stuck = ~(damping < 1e12)
        trial = best + jnp.where(stuck, 0.0, step)
        settled = stuck | (better & _shrinking(gain, at.gain, squares))
        settled |= gain <= _TOLERANCE * squares
        return _Search(
            best, squares, slope, curvature, damping, trial, gain, at.passes + 1, settled
        )

    def unfinished(at: _Search) -> JaxArray:
        return (at.passes < most) & ~jnp.all(at.settled)

    blank = jnp.ones((free, free, width), values.dtype)
    never = jnp.full(width, jnp.inf, values.dtype)
    start = _Search(
        guess,
        never,
        jnp.zeros_like(guess),
        blank,
        jnp.zeros(width, values.dtype),
        guess,
        jnp.zeros(width, values.dtype),
        jnp.zeros((), int),
        never < 0,
    )
    found = jax.lax.while_loop(unfinished, body, start)
    arrived = found.settled | (found.passes == 1)
    return jnp.where(arrived, found.trial, found.best), found.gain


def _with_stiffness(
    error: PredictionError, sums: Sums, correction: JaxArray, used: JaxArray
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Return squares, slope and curvature by the corrections, their own squares included."""
    held, slopes = error.held(correction)
    unit = np.eye(len(error.free))[..., None]
    squares = sums.squares + used * jnp.sum(error.squares_of_weighted(held), axis=0)
    slope = sums.scores.own - used * slopes * held
    return squares, slope, jnp.where(used > 0, sums.mixed.own + unit * slopes**2, unit)


def _shrinking(gain: JaxArray, before: JaxArray, squares: JaxArray) -> JaxArray:
    """Whether the step after the next, were gains to go on shrinking so, would change nothing."""
    return gain**2 <= _TOLERANCE * squares * before


@dataclass(frozen=True)
class _Factor:
    """Cholesky's lower factor of every window's curvature + damping times its diagonal.

    Few rows are written out, which is faster; of many that would take minutes to compile.
    """

    rows: list[list[JaxArray]] | JaxArray

    @classmethod
    def of(cls, curvature: JaxArray, damping: JaxArray) -> "_Factor":
        """Factor a curvature (free, free, batch)."""
        diagonal = jnp.einsum("iib->ib", curvature)
        floor = 1e-30 + 1e-13 * diagonal
        size = len(curvature)
        if size > _WRITTEN_OUT:
            return cls(_factored(curvature, diagonal * (1.0 + damping) + floor, floor))
        rows: list[list[JaxArray]] = []
        for i in range(size):
            row: list[JaxArray] = []
            for j in range(i):
                row.append((curvature[i, j] - along(row, rows[j])) / rows[j][j])
            left = diagonal[i] * (1.0 + damping) + floor[i] - along(row, row)
            rows.append([*row, jnp.sqrt(jnp.maximum(left, floor[i]))])
        return cls(rows)

    def forward(self, right: JaxArray) -> JaxArray:
        """Solve L y = right for every window, shape (free, k, batch)."""
        if not isinstance(self.rows, list):
            return _substituted(self.rows, right, range(len(right)))
        found: list[JaxArray] = []
        for i, row in enumerate(self.rows):
            found.append((right[i] - along(row[:i], found)) / row[i])
        return jnp.stack(found)

    def backward(self, right: JaxArray) -> JaxArray:
        """Solve L' x = right for every window, shape (free, k, batch)."""
        rows = self.rows
        if not isinstance(rows, list):
            return _substituted(rows.swapaxes(0, 1), right, range(len(right))[::-1])
        found: list[JaxArray] = []
        for i in reversed(range(len(rows))):
            column = [rows[k][i] for k in range(len(rows) - 1, i, -1)]
            found.append((right[i] - along(column, found)) / rows[i][i])
        return jnp.stack(found[::-1])


def _factored(matrix: JaxArray, diagonal: JaxArray, floor: JaxArray) -> JaxArray:
    """Return the lower factor (free, free, batch), column after column, pivots from a floor on."""
    below = jnp.arange(len(matrix))[:, None]

    def column(j: JaxArray, lower: JaxArray) -> JaxArray:
        left = matrix[:, j].at[j].set(diagonal[j]) - jnp.sum(lower * lower[j], axis=1)
        pivot = jnp.sqrt(jnp.maximum(left[j], floor[j]))
        return lower.at[:, j].set(jnp.where(below > j, left / pivot, 0.0).at[j].set(pivot))

    return jax.lax.fori_loop(0, len(matrix), column, jnp.zeros_like(matrix))


def _substituted(triangle: JaxArray, right: JaxArray, order: range) -> JaxArray:
    """Solve with a triangle (free, free, batch), whose rows hold what comes before in an order."""
    places = jnp.asarray(order)

    def row(k: JaxArray, found: JaxArray) -> JaxArray:
        i = places[k]
        left = right[i] - jnp.sum(triangle[i][:, None] * found, axis=0)
        return found.at[i].set(left / triangle[i, i])

    return jax.lax.fori_loop(0, len(right), row, jnp.zeros_like(right))
