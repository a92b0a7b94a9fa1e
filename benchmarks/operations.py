"""What a pass must compute at least, counted from the sizes of the network and the solver.

A product and the sum behind it are two operations, a quotient is one; tanh is counted by itself.
"""

from dataclasses import dataclass
from itertools import pairwise

STAGES = 4
STATES = 2
INPUTS = 3
DOUBLE = 8


@dataclass(frozen=True)
class Work:
    """Operations, evaluations of tanh, and bytes moved to and from memory."""

    operations: float
    tanh: float
    bytes: float

    def times(self, count: float) -> "Work":
        """Return this work done `count` times."""
        return Work(count * self.operations, count * self.tanh, count * self.bytes)


def network(sizes: tuple[int, ...]) -> Work:
    """Return the work of one evaluation of output and Jacobian, layer by layer."""
    operations, hidden, inputs = 0, sum(sizes[1:-1]), sizes[0]
    for layer, (n, m) in enumerate(pairwise(sizes)):
        operations += 2 * m * n  # weights times the layer before, and the bias
        if layer:
            operations += (2 * n - 1) * m * inputs  # weights times the Jacobian so far
        if layer < len(sizes) - 2:
            operations += 2 * m + m * inputs  # 1 - tanh^2, and the Jacobian scaled by it
    return Work(operations, hidden, 0)


def transition(sizes: tuple[int, ...]) -> Work:
    """Return the work of one step of a four-stage Runge-Kutta method and its squared error."""
    scaling = 2 + 2 + 4  # currents in; flux linkage and inductance out
    balance = 4 * STATES  # u - R i - omega J psi
    solving = 3 + 6 + 2  # determinant, Cramer's numerators, quotients
    stage = network(sizes).operations + scaling + balance + solving
    moves = (STAGES - 1) * 3 * STATES + (2 * STAGES + 1) * STATES
    error = 3 * STATES
    read = DOUBLE * (STATES + INPUTS)
    return Work(STAGES * stage + moves + error, STAGES * network(sizes).tanh, read)


def gradient(sizes: tuple[int, ...]) -> Work:
    """Return the work of forward and reverse pass: every product has two on the way back."""
    forward = transition(sizes)
    return Work(3 * forward.operations, forward.tanh, forward.bytes)


def gauss_newton(sizes: tuple[int, ...], parameters: int) -> Work:
    """Return the work of one linearised step: a reverse pass a state, S, J'r and half of J'J."""
    forward = transition(sizes)
    linearised = (1 + 2 * STATES) * forward.operations
    recursion = 2 * STATES * STATES * parameters
    products = 2 * STATES * parameters + STATES * parameters * (parameters + 1)
    return Work(linearised + recursion + products, forward.tanh, forward.bytes)
