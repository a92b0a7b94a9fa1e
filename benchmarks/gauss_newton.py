"""Streamed Gauss-Newton terms against a stored forward-mode Jacobian, and against one gradient.

Paper-size problem: 20 000 transitions, 2-6-4-2 tanh network, RK4, float64.
"""

import statistics
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import float64
from penode.data.windows import Contiguous, cut
from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import simulate
from penode.pmsm.start import weak_start
from penode.predictors.base import Predictor
from penode.training.residuals import Objective

HORIZONS = (1, 17, 50, 200)
REPEATS = 5


def stored_jacobian(objective: Objective, windows, states, inputs) -> Callable:
    """Return a compiled J'J from a forward-mode Jacobian of all residuals, held in memory."""

    def residuals(raw):
        model = objective.layout.model(objective.layout.values(raw)[:, None])

        def step(x, k):
            at = windows.starts + k
            x = objective.predictor.step(model, x, lambda offset: inputs[:, at + offset])
            return x, states[:, at + 1] - x[0]

        return jax.lax.scan(step, states[None][:, :, windows.starts], np.arange(windows.horizon))[
            1
        ].ravel()

    def normal(raw):
        jacobian = jax.jacfwd(residuals)(raw)
        return jacobian.T @ jacobian

    return jax.jit(normal)


def median_time(call: Callable[[], object]) -> float:
    """Return the median wall time of a call in s, after one call to compile."""
    call()
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def main() -> None:
    """Print accuracy, times and ratios."""
    run = simulate(TRACTION_300A, Lissajous(240.0, 14.0, 15.0), speed_rpm=1500.0, duration=2.0)
    machine, _ = weak_start([run], "mlp")
    objective = Objective(Predictor(run.time_step), machine, np.ones(2))
    raw = objective.layout.raw(machine)
    print("Gauss-Newton terms, 57 parameters, 20 000 transitions, float64, medians of 5")
    print(
        f"{'H':>4} {'terms':>10} {'gradient':>10} {'J stored':>10} {'/gradient':>10} {'stored/':>8}"
    )
    for horizon in HORIZONS:
        placement = Contiguous()
        windows = cut([run], machine.states, machine.inputs, horizon, placement=placement)
        with float64():
            states, inputs = jnp.asarray(windows.states.T), jnp.asarray(windows.inputs.T)
            stored = stored_jacobian(objective, windows, states, inputs)
            reference = np.asarray(stored(jnp.asarray(raw)))
        normal = objective.gauss_newton(raw, windows).normal
        error = np.abs(normal - reference).max() / np.abs(reference).max()
        if error > 1e-10:
            raise SystemExit(f"H = {horizon}: J'J differs by {error:.1e}; nothing is timed.")

        def by_storing(stored=stored) -> None:
            with float64():
                stored(jnp.asarray(raw)).block_until_ready()

        terms = median_time(lambda w=windows: objective.gauss_newton(raw, w))
        gradient = median_time(lambda w=windows: objective.loss_and_gradient(raw, w))
        forward = median_time(by_storing)
        print(
            f"{horizon:4d} {1e3 * terms:7.1f} ms {1e3 * gradient:7.1f} ms {1e3 * forward:7.1f} ms "
            f"{terms / gradient:9.2f}x {forward / terms:7.1f}x   J'J agrees to {error:.0e}"
        )


if __name__ == "__main__":
    main()
