"""Streamed Gauss-Newton terms against a stored forward-mode Jacobian: ``benchmarks.gauss_newton``.

Paper-size problem: 20 000 transitions, 2-6-4-2 tanh network, RK4, float64.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problem import median_time, paper_problem
from penode.arrays import float64
from penode.data.windows import Windows
from penode.training.residuals import Objective

HORIZONS = (1, 17, 50, 200)


def stored_jacobian(objective: Objective, windows: Windows) -> Callable:
    """Return a compiled J'J from a forward-mode Jacobian of all residuals, held in memory."""
    states, inputs = jnp.asarray(windows.states.T), jnp.asarray(windows.inputs.T)

    def residuals(raw):
        model = objective.layout.model(objective.layout.values(raw)[:, None])

        def step(x, k):
            at = windows.starts + k
            x = objective.predictor.step(model, x, lambda offset: inputs[:, at + offset])
            return x, states[:, at + 1] - x[0]

        start = states[None][:, :, windows.starts]
        return jax.lax.scan(step, start, np.arange(windows.horizon))[1].ravel()

    def normal(raw):
        jacobian = jax.jacfwd(residuals)(raw)
        return jacobian.T @ jacobian

    return jax.jit(normal)


def main() -> None:
    """Print accuracy, times and ratios."""
    problem = paper_problem()
    objective, raw = problem.objective, problem.raw
    print("Gauss-Newton terms, 57 parameters, 20 000 transitions, float64, medians of 5")
    print(f"{'H':>4} {'streamed':>10} {'J stored':>10} {'stored/streamed':>16}")
    for horizon in HORIZONS:
        windows = problem.windows(horizon)
        with float64():
            stored = stored_jacobian(objective, windows)
            reference = np.asarray(stored(jnp.asarray(raw)))
        normal = objective.gauss_newton(raw, windows).normal
        error = np.abs(normal - reference).max() / np.abs(reference).max()
        if error > 1e-10:
            raise SystemExit(f"H = {horizon}: J'J differs by {error:.1e}; nothing is timed.")

        def by_storing(stored=stored) -> None:
            with float64():
                stored(jnp.asarray(raw)).block_until_ready()

        terms = median_time(lambda w=windows: objective.gauss_newton(raw, w))
        storing = median_time(by_storing)
        print(
            f"{horizon:4d} {1e3 * terms:7.1f} ms {1e3 * storing:7.1f} ms {storing / terms:15.1f}x"
            f"   J'J agrees to {error:.0e}"
        )


if __name__ == "__main__":
    main()
