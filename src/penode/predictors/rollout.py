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

    Parameters
    ----------
    step : callable
        ``step(k, history) -> (history, extra)``: one prediction from sample k of the window, put in
        front of the history, and anything the visitor wants to know of it, such as its
        linearisation.
    start : array, shape (past, state, batch), or pytree
        Measured states at the windows' starts and before, and what goes on beside them.
    horizon : int or scalar array
        Number of steps H. A Python int gives a loop that reverse mode can differentiate; an array
        gives one program for every H (forward sensitivities need no reverse pass).
    visit : callable
        ``visit(k, history, extra, carry) -> carry``: receives each prediction, history[0], for
        k = 0 .. H - 1.
    carry : pytree
        What the visitor accumulates.

    Returns
    -------
    pytree
        The last carry.
    """

    def body(k: JaxArray, state: tuple[Any, Carry]) -> tuple[Any, Carry]:
        history, extra = step(k, state[0])
        return history, visit(k, history, extra, state[1])

    result: tuple[Any, Carry] = jax.lax.fori_loop(0, horizon, body, (start, carry))
    return result[1]
