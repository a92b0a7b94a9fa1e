"""Forward sensitivities over a horizon: Gauss-Newton terms of one batch of windows, J never stored.

One vector-Jacobian product a state and output gives the recursion of S exactly (`_Recursion`). The
columns of S are the parameters' values and, behind them, the corrections of free starts.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.models.layout import Parts
from penode.native.normal_matrix import NormalMatrix
from penode.predictors.rollout import rollout
from penode.training.prediction_error import Batch, PredictionError


class Sums(NamedTuple):
    """Sums over the steps of each window; r is the residual, S = -dr/d(column).

    Attributes
    ----------
    squares : array, shape (batch,)
        r'r.
    scores : array, shape (column, batch)
        S'r.
    own : array, shape (free, column, batch)
        Rows of S'S that belong to the window's own columns, those of its start.
    normal : NormalMatrix
        S'S of the shared columns, summed over windows too.
    """

    squares: JaxArray
    scores: JaxArray
    own: JaxArray
    normal: NormalMatrix


def window_sums(
    error: PredictionError,
    values: JaxArray,
    correction: JaxArray,
    horizon: JaxArray,
    batch: Batch,
    normal: NormalMatrix,
) -> Sums:
    """Predict a batch of windows and sum what Gauss and Newton need.

    Parameters
    ----------
    error : PredictionError
    values : array, shape (value, batch)
        Parameters, one column a window.
    correction : array, shape (free, batch)
        Of the windows' starts, SI units.
    horizon : scalar array
        Steps, known at run time only.
    batch : Batch
    normal : NormalMatrix
        What S'S of the parameters is added to; of size 0 where only the windows' own starts are
        columns.
    """
    parts = error.layout.split(values)
    recursion = _Recursion(error, parts, horizon, batch, len(normal.lower))
    start, first = recursion.start(correction)
    prefilter = error.loss.prefilter

    def visit(k: JaxArray, history: JaxArray, pull_back: Any, carry: Any) -> Any:
        sensitivity, (before, slopes_before), sums = carry
        sensitivity = recursion.ahead(history, pull_back, sensitivity)
        residual, slopes = recursion.residual(k + 1, history[0], sensitivity[0])
        filtered, before = prefilter.advance(before, residual * batch.used)
        slopes, slopes_before = prefilter.advance(slopes_before, slopes * batch.used)
        return sensitivity, (before, slopes_before), _added(sums, filtered, slopes)

    columns, width = first.shape[2], values.shape[1]
    shape = (prefilter.order, len(error.compared))

    def zeros(*shape: int) -> JaxArray:
        return jnp.zeros(shape, values.dtype)

    memory = (zeros(*shape, width), zeros(*shape, columns, width))
    own = zeros(len(error.free), columns, width)
    sums = Sums(zeros(width), zeros(columns, width), own, normal)
    last: Sums = rollout(recursion.step, start, horizon, visit, (first, memory, sums))[2]
    return last


@dataclass(frozen=True, eq=False)
class _Recursion:
    """The sensitivity S = dx/d(column) of a batch of windows, from its start to each step.

    Attributes
    ----------
    error : PredictionError
    parts : tuple of arrays
        Values of each parameter.
    horizon : scalar array
    batch : Batch
    shared : int
        Leading columns that are parameters; behind them are the free starts.
    """

    error: PredictionError
    parts: Parts
    horizon: JaxArray
    batch: Batch
    shared: int

    def start(self, correction: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return x_0 (past, state, batch) and S_0 (past, state, column, batch).

        S_0 is dx_0/dtheta, and one where a column is the correction of that state.
        """
        error, batch = self.error, self.batch
        start, pull_back = jax.vjp(lambda p: error.start(p, correction, batch), self.parts)
        rows = (pull_back(_unit(start, at))[0] for at in np.ndindex(*start.shape[:2]))
        first = jnp.stack([_joined(row)[: self.shared] for row in rows])
        own = jnp.zeros((len(first), len(error.free), first.shape[-1]), first.dtype)
        own = own.at[error.free, np.arange(len(error.free))].set(1.0)
        first = jnp.concatenate([first, own], axis=1)
        return start, first.reshape(*start.shape[:2], -1, start.shape[-1])

    def step(self, k: JaxArray, history: JaxArray) -> tuple[JaxArray, Any]:
        """Return x_(k+1) = g(x_k, ..., theta) in front of its past, and g's pull-back."""
        error, batch = self.error, self.batch
        return jax.vjp(lambda p, h: error.step(p, h, k, batch), self.parts, history)

    def ahead(self, history: JaxArray, pull_back: Any, sensitivity: JaxArray) -> JaxArray:
        """Return S_(k+1) = (dg/dx) S_k + dg/dtheta in front of its past."""
        units = jnp.stack([_unit(history, (0, i)) for i in range(history.shape[1])])
        direct, before = jax.vmap(pull_back)(units)
        ahead = jax.vmap(self._row, in_axes=(0, 0, None))(direct, before, sensitivity)[None]
        return jnp.concatenate([ahead, sensitivity[:-1]]) if len(sensitivity) > 1 else ahead

    def residual(
        self, step: JaxArray, predicted: JaxArray, sensitivity: JaxArray
    ) -> tuple[JaxArray, JaxArray]:
        """Return r (output, batch) and -dr/d(column) = -(dr/dx) S - dr/dtheta."""
        error, batch = self.error, self.batch
        residual, pull_back = jax.vjp(
            lambda p, x: error.residual(p, x, step, self.horizon, batch), self.parts, predicted
        )
        products = [pull_back(_unit(residual, (i,))) for i in range(len(residual))]
        if not error.plain:
            rows = [self._row(direct, before, sensitivity) for direct, before in products]
            return residual, -jnp.stack(rows)
        # -dr/dx is the weight: a product with its zeros would cost a fifth.
        weight = error.weight(step, self.horizon)[error.compared][:, None, None]
        direct = jnp.stack([_joined(own)[: self.shared] for own, _ in products])
        return residual, _less(weight * sensitivity[error.compared], direct)

    def _row(self, direct: Parts, before: JaxArray, sensitivity: JaxArray) -> JaxArray:
        """Return one row of the chain rule, (df/dx) S + df/dtheta, shape (column, batch)."""
        own = _joined(direct)[: self.shared]
        carried = jnp.sum(before[..., None, :] * sensitivity, axis=tuple(range(before.ndim - 1)))
        return carried.at[: self.shared].add(own) if len(self.error.free) else carried + own


def _added(sums: Sums, residual: JaxArray, slopes: JaxArray) -> Sums:
    """Add one step's filtered residual (output, batch) and slopes (output, column, batch)."""
    lead = len(sums.normal.lower)
    shared, own = slopes[:, :lead], slopes[:, lead:]
    return Sums(
        sums.squares + jnp.sum(residual**2, axis=0),
        sums.scores + jnp.sum(slopes * residual[:, None], axis=0),
        sums.own + jnp.sum(own[:, :, None] * slopes[:, None], axis=0),
        sums.normal.plus(shared),
    )


def _less(slopes: JaxArray, direct: JaxArray) -> JaxArray:
    """Take the shared columns' direct slopes (output, value, batch) off all columns' slopes."""
    lead = direct.shape[1]
    return slopes - direct if slopes.shape[1] == lead else slopes.at[:, :lead].add(-direct)


def _joined(parts: Parts) -> JaxArray:
    return jnp.concatenate(parts)


def _unit(like: JaxArray, at: tuple[int, ...]) -> JaxArray:
    return jnp.zeros_like(like).at[at].set(1.0)
