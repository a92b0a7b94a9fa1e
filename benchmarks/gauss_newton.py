"""Streamed Gauss-Newton terms against a stored forward-mode Jacobian: ``benchmarks.gauss_newton``.

Paper-size problem: 20 000 transitions, 2-6-4-2 tanh network, RK4, float64. Then the two maps that
follow the angle, the default's splines and the convex network: what an evaluation costs.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problem import median_time, paper_problem, paper_recording, problem_of
from penode.arrays import float64
from penode.data.windows import Windows
from penode.pmsm.balance.start import weak_start
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


def maps_over_the_angle() -> None:
    """Print what an evaluation costs with the maps that follow the angle, and check its descent."""
    run, seconds = paper_recording(), {}
    print("Maps with the angle orders 6 and 12, 20 000 transitions, H = 40")
    for kind in ("convex", "coenergy"):
        problem = problem_of(run, weak_start([run], kind, angle_orders=(6, 12)).machine)
        objective, raw, windows = problem.objective, problem.raw, problem.windows(40)
        way = 1e-7 * np.random.default_rng(0).normal(size=len(raw))
        terms = objective.gauss_newton(raw, windows)
        ahead, behind = (objective.gauss_newton(raw + s * way, windows).loss for s in (1.0, -1.0))
        error = abs((ahead - behind) / 2 / (-2 * terms.descent @ way / terms.count) - 1)
        if error > 1e-4:
            raise SystemExit(f"{kind}: the descent differs by {error:.1e}; nothing is timed.")
        seconds[kind] = median_time(lambda o=objective, r=raw, w=windows: o.gauss_newton(r, w))
        print(
            f"{kind:>10} {len(raw):4d} parameters {1e3 * seconds[kind]:7.1f} ms of processor"
            f"   descent agrees to {error:.0e}"
        )
    print(f"coenergy over convex {seconds['coenergy'] / seconds['convex']:.1f}x")


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
    maps_over_the_angle()


if __name__ == "__main__":
    main()
