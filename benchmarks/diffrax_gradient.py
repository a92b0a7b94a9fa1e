"""Loss and gradient against diffrax: ``taskset -c 0 python -m benchmarks.diffrax_gradient``.

diffrax integrates the same machine with the classic Runge-Kutta table as a custom solver at one
constant step a sample, saves every step, and differentiates by its RecursiveCheckpointAdjoint.
All contiguous windows are one batch-last state; both sides are compiled, float64, one thread.
Nothing is timed unless loss and gradient agree.
"""

from collections.abc import Callable
from typing import ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problem import Problem, check, median_time, paper_problem
from penode.arrays import FloatArray, float64
from penode.data.windows import Windows
from penode.models.inputs import Inputs

HORIZONS = (1, 50, 100, 200)
#: Of a sample; the times of diffrax's steps are whole numbers up to rounding only.
HAIR = 1e-6


class ClassicRungeKutta(diffrax.AbstractERK):
    """The classic table; its error estimate is not used at a constant step."""

    # The last stage is early by two hairs, so that it still sees the step's own input.
    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        c=np.array([0.5, 0.5, 1.0 - 2 * HAIR]),
        b_sol=np.array([1.0, 2.0, 2.0, 1.0]) / 6,
        b_error=np.array([1.0, -1.0, -1.0, 1.0]) / 6,
        a_lower=(np.array([0.5]), np.array([0.0, 0.5]), np.array([0.0, 0.0, 1.0])),
    )
    interpolation_cls: ClassVar[Callable] = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def order(self, terms):
        return 4


def by_diffrax(problem: Problem, windows: Windows) -> Callable[[], tuple[float, FloatArray]]:
    """Return a function that gives loss and gradient (parameter,), compiled by its first call."""
    horizon, layout = windows.horizon, problem.objective.layout
    at = np.arange(horizon)[:, None] + windows.starts
    with float64():
        inputs = jnp.asarray(windows.inputs[at].swapaxes(1, 2))
        targets = jnp.asarray(windows.states[at + 1].swapaxes(1, 2))
        start, raw = jnp.asarray(windows.states[windows.starts].T), jnp.asarray(problem.raw)

    def field(sample, x, machine):
        u = Inputs(inputs[(sample + HAIR).astype(int)], machine.inputs)
        return windows.time_step * machine.derivative(x, u)

    @jax.jit
    @jax.value_and_grad
    def evaluate(raw):
        path = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            ClassicRungeKutta(),
            t0=0.0,
            t1=float(horizon),
            dt0=1.0,
            y0=start,
            args=layout.model(layout.values(raw)[:, None]),
            saveat=diffrax.SaveAt(steps=True),
            adjoint=diffrax.RecursiveCheckpointAdjoint(),
            max_steps=horizon,
        )
        return jnp.mean((targets - path.ys) ** 2)

    def call() -> tuple[float, FloatArray]:
        with float64():
            loss, gradient = evaluate(raw)
            return float(loss), np.asarray(gradient)

    return call


def main() -> None:
    """Print agreement, times and ratios."""
    problem = paper_problem()
    print(f"Loss and gradient, {len(problem.raw)} parameters, 20 000 transitions, medians of 5")
    print(f"diffrax {diffrax.__version__}, jax {jax.__version__}")
    print(f"{'H':>4} {'penode':>10} {'diffrax':>10} {'ratio':>7}")
    for horizon in HORIZONS:
        windows = problem.windows(horizon)
        theirs, objective = by_diffrax(problem, windows), problem.objective
        wanted = objective.loss_and_gradient(problem.raw, windows)
        error = check(f"H = {horizon}", theirs(), wanted)
        ours = median_time(lambda o=objective, w=windows: o.loss_and_gradient(problem.raw, w))
        rival = median_time(theirs)
        print(
            f"{horizon:4d} {1e3 * ours:7.1f} ms {1e3 * rival:7.1f} ms {rival / ours:6.1f}x"
            f"   agree to {error:.0e}",
            flush=True,
        )


if __name__ == "__main__":
    main()
