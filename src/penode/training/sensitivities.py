"""Forward sensitivities over a horizon: Gauss-Newton terms of one batch of windows, J never stored.

One vector-Jacobian product a state and output gives the recursion of S exactly (`Recursion`), or,
where states are many and columns few, one Jacobian-vector product a column. The columns of S are
the parameters' values and, behind them, the corrections of free starts.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.models.layout import Parts
from penode.native.normal_matrix import NormalMatrix
from penode.predictors.rollout import rollout
from penode.training.prediction_error import Batch, PredictionError

Carry = TypeVar("Carry")

#: States from which products with the Jacobian are matrix products, one a window: of 50 seven times
#: as fast, of fewer slower than sums that are fused with what makes them.
_MANY = 16


class Columns(NamedTuple):
    """Slopes (..., column, batch) by the parameters' values and by corrections of free starts."""

    shared: JaxArray
    own: JaxArray

    def each(self, function: Callable[..., JaxArray], *others: "Columns") -> "Columns":
        """Apply a function to both parts, with those of others beside them."""
        return Columns(*map(function, self, *others))


class Sums(NamedTuple):
    """Sums over the steps of each window; r is the residual, S = -dr/d(column)."""

    # r'r, (batch,).
    squares: JaxArray
    # S'r, (column, batch).
    scores: Columns
    # Rows of S'S of the window's own columns, those of its start, (free, column, batch).
    mixed: Columns
    # S'S of the shared columns, summed over windows too.
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

    Values are (value, batch), or (value, 1) where no parameter is a column of S; the correction of
    starts is (free, batch), SI units. S'S is added to `normal`, of size 0 where only the starts are
    columns.
    """
    free, width = len(error.free), len(batch.starts)
    lead = len(normal.lower)

    def zeros(*shape: int) -> JaxArray:
        return jnp.zeros((*shape, width), values.dtype)

    def add(k: JaxArray, residual: JaxArray, slopes: Columns, sums: Sums) -> Sums:
        return _added(error, sums, residual, slopes)

    scores, mixed = (Columns(zeros(*axes, lead), zeros(*axes, free)) for axes in ((), (free,)))
    recursion = Recursion(error, error.layout.split(values), horizon, batch, lead)
    return recursion.over_steps(correction, add, Sums(zeros(), scores, mixed, normal))


@dataclass(frozen=True, eq=False)
class Recursion:
    """The sensitivity S = dx/d(column) of a batch of windows, from its start to each step."""

    error: PredictionError
    parts: Parts
    horizon: JaxArray
    batch: Batch
    # Columns that are parameters; none where only the free starts are columns.
    shared: int
    # What free starts shrink by as a value grows, (free, value, batch): no columns of theirs then.
    follow: JaxArray | None = None

    @property
    def own(self) -> int:
        """Columns that are corrections of free starts."""
        return len(self.error.free) if self.follow is None else 0

    def over_steps(
        self,
        correction: JaxArray,
        add: Callable[[JaxArray, JaxArray, Columns, Carry], Carry],
        carry: Carry,
    ) -> Carry:
        """Visit each step's filtered residual and slopes; corrections (free, batch) in SI units.

        ``add(k, residual, slopes, carry) -> carry`` gets the residual (output, batch) and slopes
        (output, column, batch) of sample k + 1, under noise with outliers by the roots of weights.
        """
        start, first = self.start(correction)
        prefilter, batch = self.error.loss.prefilter, self.batch
        if self.error.model.outputs:  # a window's first sample is measured like any other
            at_start = first.each(lambda part: part[0])
            residual, slopes = self.residual(jnp.zeros((), int), start[0], at_start)
            used = slopes.each(lambda part: part * batch.used)
            carry = add(jnp.asarray(-1), *self.weighted(residual * batch.used, used), carry)
        shape = (prefilter.order, len(self.error.compared))

        def zeros(*axes: int) -> JaxArray:
            return jnp.zeros((*shape, *axes, len(batch.starts)), start.dtype)

        def visit(k: JaxArray, at: tuple[JaxArray, Columns], _: None, state: Any) -> Any:
            (history, sensitivity), ((before, shared_before, own_before), carry) = at, state
            newest = sensitivity.each(lambda part: part[0])
            residual, slopes = self.residual(k + 1, history[0], newest)
            filtered, before = prefilter.advance(before, residual * batch.used)
            shared, shared_before = prefilter.advance(shared_before, slopes.shared * batch.used)
            own, own_before = prefilter.advance(own_before, slopes.own * batch.used)
            memory = before, shared_before, own_before
            return memory, add(k, *self.weighted(filtered, Columns(shared, own)), carry)

        memory = zeros(), zeros(self.shared), zeros(self.own)
        return rollout(self.step, (start, first), self.horizon, visit, (memory, carry))[1]

    def weighted(self, residual: JaxArray, slopes: Columns) -> tuple[JaxArray, Columns]:
        """Return residuals (output, batch) and slopes by the roots of the residuals' weights."""
        noise = self.error.loss.noise
        if noise is None:
            return residual, slopes
        root = jnp.sqrt(noise.weight(residual))
        return root * residual, slopes.each(lambda part: part * root[:, None])

    def start(self, correction: JaxArray) -> tuple[JaxArray, Columns]:
        """Return x_0 (past, state, batch) and S_0 of shape (past, state, column, batch).

        S_0 is dx_0/dtheta, and one where a column is the correction of that state.
        """
        error, batch = self.error, self.batch
        start, pull_back = jax.vjp(lambda p: error.start(p, correction, batch), self.parts)
        units = jnp.stack([_unit(start, at) for at in np.ndindex(*start.shape[:2])])
        rows = jax.vmap(lambda unit: _joined(pull_back(unit)[0])[: self.shared])(units)
        width = len(batch.starts)
        wide = (*start.shape[:2], self.shared, width)
        shared = jnp.broadcast_to(rows, (len(units), *wide[2:])).reshape(wide)
        if self.follow is not None:
            shared = shared.at[0, error.free].add(-self.follow)
        own = jnp.zeros((*start.shape[:2], self.own, width), start.dtype)
        own = own.at[0, error.free[: self.own], np.arange(self.own)].set(1.0)
        return start, Columns(shared, own)

    def step(
        self, k: JaxArray, at: tuple[JaxArray, Columns]
    ) -> tuple[tuple[JaxArray, Columns], None]:
        """Return x_(k+1) = g(x_k, ..., theta) in front of its past, and S_(k+1)."""
        error, batch = self.error, self.batch

        def through(
            function: Callable[[Parts, JaxArray], JaxArray], at: tuple[JaxArray, Columns]
        ) -> tuple[JaxArray, Columns]:
            if self._few_columns(at[0]):
                history, push = jax.linearize(function, self.parts, at[0])
                return history, self.pushed(push, at[1])
            history, pull_back = jax.vjp(function, self.parts, at[0])
            return history, self.ahead(history, pull_back, at[1])

        def substep(
            number: JaxArray | int, at: tuple[JaxArray, Columns]
        ) -> tuple[JaxArray, Columns]:
            return through(lambda p, h: error.substep(p, h, k, number, batch), at)

        if error.filters:
            at = through(lambda p, h: error.updated(p, h, k, batch), at)
        if error.predictor.table is None:
            return substep(0, at), None
        return jax.lax.fori_loop(0, batch.substeps, substep, at), None

    def _few_columns(self, history: JaxArray) -> bool:
        """Whether products of the Jacobian with all columns take less than the Jacobian itself."""
        states = history.shape[1]
        return states >= _MANY and self.shared + self.own <= 2 * states

    def pushed(self, push: Callable[..., JaxArray], sensitivity: Columns) -> Columns:
        """Return S_(k+1) by one product of the Jacobian with each column, past included."""
        shared, own = sensitivity
        if self.shared:
            units = jnp.eye(self.shared, dtype=shared.dtype)[..., None]
            units = jnp.broadcast_to(units, (*units.shape[:2], shared.shape[-1]))
            parts = jax.vmap(self.error.layout.split)(units)
            shared = jax.vmap(push, in_axes=(0, -2), out_axes=-2)(parts, shared)
        if self.own:
            nothing = jax.tree.map(jnp.zeros_like, self.parts)
            own = jax.vmap(push, in_axes=(None, -2), out_axes=-2)(nothing, own)
        return Columns(shared, own)

    def ahead(self, history: JaxArray, pull_back: Any, sensitivity: Columns) -> Columns:
        """Return S_(k+1) = (dg/dx) S_k + dg/dtheta in front of its past."""
        units = jnp.stack([_unit(history, (0, i)) for i in range(history.shape[1])])
        direct, before = jax.vmap(pull_back)(units)
        if len(units) < _MANY:
            row = jax.vmap(self._row, in_axes=(0, 0, None))(direct, before, sensitivity)
        else:
            carried = sensitivity.each(lambda part: jnp.einsum("ipjb,pjcb->icb", before, part))
            joined = jax.vmap(lambda one: _joined(one)[: self.shared])(direct)
            row = carried._replace(shared=carried.shared + joined)
        ahead = row.each(lambda part: part[None])
        if len(sensitivity.own) == 1:
            return ahead
        return ahead.each(lambda new, old: jnp.concatenate([new, old[:-1]]), sensitivity)

    def residual(
        self, step: JaxArray, predicted: JaxArray, sensitivity: Columns
    ) -> tuple[JaxArray, Columns]:
        """Return r (output, batch) and -dr/d(column) = -(dr/dx) S - dr/dtheta."""
        error, batch = self.error, self.batch
        residual, pull_back = jax.vjp(
            lambda p, x: error.residual(p, x, step, self.horizon, batch), self.parts, predicted
        )
        products = [pull_back(_unit(residual, (i,))) for i in range(len(residual))]
        if not error.plain:
            rows = [self._row(direct, before, sensitivity) for direct, before in products]
            return residual, Columns(*(-jnp.stack(part) for part in zip(*rows, strict=True)))
        # -dr/dx is the weight: a product with its zeros would cost a fifth.
        weight = error.weight(step, self.horizon)[error.compared][:, None, None]
        direct = jnp.stack([_joined(own)[: self.shared] for own, _ in products])
        shared, own = sensitivity.each(lambda part: weight * part[error.compared])
        return residual, Columns(shared - direct, own)

    def _row(self, direct: Parts, before: JaxArray, sensitivity: Columns) -> Columns:
        """Return one row of the chain rule, (df/dx) S + df/dtheta, of shape (column, batch)."""
        axes = tuple(range(before.ndim - 1))
        carried = sensitivity.each(lambda part: jnp.sum(before[..., None, :] * part, axis=axes))
        return Columns(carried.shared + _joined(direct)[: self.shared], carried.own)


def _added(error: PredictionError, sums: Sums, residual: JaxArray, slopes: Columns) -> Sums:
    """Add one step's filtered residual (output, batch) and slopes of (output, column, batch)."""
    scores = sums.scores.each(lambda sum, part: sum + along(residual, part), slopes)
    own = slopes.own.swapaxes(0, 1)
    mixed = sums.mixed.each(
        lambda sum, part: sum + jax.vmap(lambda one: along(one, part))(own) if len(own) else sum,
        slopes,
    )
    squares = sums.squares + jnp.sum(error.squares_of_weighted(residual), axis=0)
    return Sums(squares, scores, mixed, sums.normal.plus(slopes.shared))


def along(weights: Iterable[JaxArray], parts: Iterable[JaxArray]) -> JaxArray | float:
    """Return the sum of weights (batch,) times parts (..., batch), of as many as there are weights.

    Written out: a reduction over so few would first write all products down.
    """
    products = [weight * part for weight, part in zip(weights, parts, strict=False)]
    return sum(products[1:], products[0]) if products else 0.0


def _joined(parts: Parts) -> JaxArray:
    return jnp.concatenate(parts)


def _unit(like: JaxArray, at: tuple[int, ...]) -> JaxArray:
    return jnp.zeros_like(like).at[at].set(1.0)
