"""The recursion over a horizon, one for training, sensitivities and free run."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax

from penode.arrays import JaxArray

Carry = TypeVar("Carry")


def rollout(
    step: Callable[[JaxArray, Any], tuple[Any, Any]],
    start: Any,
    horizon: int | JaxArray,
    visit: Callable[[JaxArray, Any, Any, Carry], Carry],
    carry: Carry,
) -> Carry:
    """Feed a predictor its own output for `horizon` steps (paper, k-step-ahead prediction).

    ``step(k, history) -> (history, extra)`` puts one prediction from sample k of the window in
    front of the history (past, state, batch); ``visit(k, history, extra, carry) -> carry`` receives
    each. An int for the horizon gives a loop that reverse mode can differentiate; an array gives
    one program for every horizon.
    """

    def body(k: JaxArray, state: tuple[Any, Carry]) -> tuple[Any, Carry]:
        history, extra = step(k, state[0])
        return history, visit(k, history, extra, state[1])

    result: tuple[Any, Carry] = jax.lax.fori_loop(0, horizon, body, (start, carry))
    return result[1]
