"""Implicit one-step methods for stiff systems, differentiated by the implicit function theorem.

The paper leaves implicit predictors out; these are an extension of it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.models.base import Model
from penode.predictors.field import Field

#: Newton stops at this relative change, or after this many iterations.
_TOLERANCE = 1e-12
_ITERATIONS = 30


@dataclass(frozen=True)
class ImplicitMidpoint:
    """x_(k+1) = x_k + T f((x_k + x_(k+1)) / 2): symplectic, second order, A-stable."""

    @property
    def order(self) -> int:
        """Order of convergence."""
        return 2

    @property
    def past(self) -> int:
        """Measured samples a prediction starts from."""
        return 1

    def advance(self, field: Field, history: JaxArray) -> JaxArray:
        """Return the next state (state, batch) from history (1, state, batch)."""

        def defect(arguments: tuple[Model, JaxArray], z: JaxArray) -> JaxArray:
            at, x = replace(field, model=arguments[0]), arguments[1]
            return z - x - at.width * at(0.5 * (x + z), fraction=0.5, part=(0.0, 1.0))

        return solve_implicit(defect, (field.model, history[0]), history[0])


@dataclass(frozen=True)
class Trapezoidal:
    """x_(k+1) = x_k + T (f(x_k) + f(x_(k+1))) / 2: second order, A-stable."""

    @property
    def order(self) -> int:
        """Order of convergence."""
        return 2

    @property
    def past(self) -> int:
        """Measured samples a prediction starts from."""
        return 1

    def advance(self, field: Field, history: JaxArray) -> JaxArray:
        """Return the next state (state, batch) from history (1, state, batch)."""

        def defect(arguments: tuple[Model, JaxArray], z: JaxArray) -> JaxArray:
            at, x = replace(field, model=arguments[0]), arguments[1]
            begin, end = at(x, part=(0.0, 0.5)), at(z, fraction=1.0, part=(0.5, 1.0))
            return z - x - 0.5 * at.width * (begin + end)

        return solve_implicit(defect, (field.model, history[0]), history[0])


def solve_implicit(
    defect: Callable[[Any, JaxArray], JaxArray], arguments: Any, guess: JaxArray
) -> JaxArray:
    """Find z (state, batch) with defect(arguments, z) = 0 by Newton's method, column by column.

    The iterations are hidden from differentiation. One more Newton step with a frozen Jacobian then
    carries exactly the derivative of the implicit function theorem by all of `arguments`, forward
    and reverse.
    """
    frozen = jax.lax.stop_gradient(arguments)

    def newton(z: JaxArray, at: Any) -> JaxArray:
        return _solve_columns(jacobian_of(lambda y: defect(frozen, y), z), defect(at, z))

    def iterate(state: tuple[JaxArray, JaxArray, JaxArray]) -> tuple[JaxArray, JaxArray, JaxArray]:
        z, _, count = state
        step = newton(z, frozen)
        change = jnp.max(jnp.abs(step) / (1e-300 + jnp.max(jnp.abs(z)) + jnp.abs(step)))
        return z - step, change, count + 1

    def unfinished(state: tuple[JaxArray, JaxArray, JaxArray]) -> JaxArray:
        return (state[1] > _TOLERANCE) & (state[2] < _ITERATIONS)

    begin = jax.lax.stop_gradient(guess)
    nothing_yet = (begin, jnp.full((), jnp.inf, begin.dtype), jnp.zeros((), jnp.int32))
    root = jax.lax.stop_gradient(jax.lax.while_loop(unfinished, iterate, nothing_yet)[0])
    jacobian = jax.lax.stop_gradient(jacobian_of(lambda y: defect(frozen, y), root))
    return root - _solve_columns(jacobian, defect(arguments, root))


def jacobian_of(function: Callable[[JaxArray], JaxArray], z: JaxArray) -> JaxArray:
    """Return d function / d z, shape (batch, state, state), of a column-wise function."""
    seeds = jnp.eye(z.shape[0], dtype=z.dtype)
    columns = [jax.jvp(function, (z,), (jnp.zeros_like(z) + s[:, None],))[1] for s in seeds]
    return jnp.stack(columns, axis=-1).transpose(1, 0, 2)


def _solve_columns(matrices: JaxArray, columns: JaxArray) -> JaxArray:
    solved: JaxArray = jnp.linalg.solve(matrices, columns.T[..., None])
    across: JaxArray = solved[..., 0].T
    return across
