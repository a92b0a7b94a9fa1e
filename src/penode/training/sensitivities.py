"""Forward sensitivities over a horizon: Gauss-Newton terms of one batch of windows, J never stored.

One vector-Jacobian product a state and output gives S_(k+1) = (dg/dx) S_k + dg/dtheta exactly. The
columns of S are the parameters' values and, behind them, the corrections of free starts.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.models.layout import Parts
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
    normal : array, shape (value, value)
        S'S of the shared columns, summed over windows too.
    """

    squares: JaxArray
    scores: JaxArray
    own: JaxArray
    normal: JaxArray


def window_sums(
    error: PredictionError,
    values: JaxArray,
    correction: JaxArray,
    horizon: JaxArray,
    batch: Batch,
    shared: bool = True,
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
    shared : bool
        Whether the parameters are columns too, or only the windows' own starts.
    """
    lead = values.shape[0] if shared else 0
    parts = error.layout.split(values)

    def linear(direct: Parts, before: JaxArray, sensitivity: JaxArray) -> JaxArray:
        """Return one row of the chain rule, shape (column, batch)."""
        own = _joined(direct)
        carried = jnp.sum(before[..., None, :] * sensitivity, axis=tuple(range(before.ndim - 1)))
        return carried.at[:lead].add(own[:lead]) if len(error.free) else carried + own[:lead]

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, Any]:
        return jax.vjp(lambda p, h: error.step(p, h, k, batch), parts, history)

    def visit(k: JaxArray, history: JaxArray, pull: Any, carry: Any) -> Any:
        sensitivity, memory, sums = carry
        pulled = [pull(_unit(history, (0, i))) for i in range(history.shape[1])]
        rows = [linear(own, before, sensitivity) for own, before in pulled]
        ahead = jnp.stack(rows)[None]
        sensitivity = jnp.concatenate([ahead, sensitivity[:-1]]) if len(sensitivity) > 1 else ahead
        residual, pull = jax.vjp(
            lambda p, x: error.residual(p, x, k + 1, horizon, batch), parts, history[0]
        )
        pulled = [pull(_unit(residual, (i,))) for i in range(len(residual))]
        if error.plain:  # dr/dx is known, and a product with its zeros would cost a fifth
            weight = error.weight(k + 1, horizon)[error.compared][:, None, None]
            direct = jnp.stack([_joined(own)[:lead] for own, _ in pulled])
            slopes = _less(weight * sensitivity[0][error.compared], direct)
        else:
            rows = [linear(own, before, sensitivity[0]) for own, before in pulled]
            slopes = -jnp.stack(rows)
        filtered, first = error.loss.prefilter.advance(memory[0], residual * batch.used)
        slopes, second = error.loss.prefilter.advance(memory[1], slopes * batch.used)
        return sensitivity, (first, second), _added(sums, filtered, slopes)

    start, pull = jax.vjp(lambda p: error.start(p, correction, batch), parts)
    places = np.ndindex(*start.shape[:2])
    first = jnp.stack([_joined(pull(_unit(start, at))[0])[:lead] for at in places])
    own = jnp.zeros((*first.shape[:1], len(error.free), first.shape[-1]), values.dtype)
    own = own.at[error.free, np.arange(len(error.free))].set(1.0)
    first = jnp.concatenate([first, own], axis=1).reshape(*start.shape[:2], -1, start.shape[-1])
    columns, free, width = first.shape[2], len(error.free), values.shape[1]
    shape = (error.loss.prefilter.order, len(error.compared))
    memory = (
        jnp.zeros((*shape, width), values.dtype),
        jnp.zeros((*shape, columns, width), values.dtype),
    )
    sums = Sums(
        jnp.zeros(width, values.dtype),
        jnp.zeros((columns, width), values.dtype),
        jnp.zeros((free, columns, width), values.dtype),
        jnp.zeros((lead, lead), values.dtype),
    )
    return rollout(step, start, horizon, visit, (first, memory, sums))[2]


def _added(sums: Sums, residual: JaxArray, slopes: JaxArray) -> Sums:
    """Add one step's filtered residual (output, batch) and slopes (output, column, batch)."""
    lead = len(sums.normal)
    shared, own = slopes[:, :lead], slopes[:, lead:]
    return Sums(
        sums.squares + jnp.sum(residual**2, axis=0),
        sums.scores + jnp.sum(slopes * residual[:, None], axis=0),
        sums.own + jnp.sum(own[:, :, None] * slopes[:, None], axis=0),
        sums.normal + jnp.einsum("oib,ojb->ij", shared, shared),
    )


def _less(slopes: JaxArray, direct: JaxArray) -> JaxArray:
    """Take the shared columns' direct slopes (output, value, batch) off all columns' slopes."""
    lead = direct.shape[1]
    return slopes - direct if slopes.shape[1] == lead else slopes.at[:, :lead].add(-direct)


def _joined(parts: Parts) -> JaxArray:
    return jnp.concatenate(parts)


def _unit(like: JaxArray, at: tuple[int, ...]) -> JaxArray:
    return jnp.zeros_like(like).at[at].set(1.0)
