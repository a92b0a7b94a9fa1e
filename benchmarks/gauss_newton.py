"""Streamed Gauss-Newton terms against a stored forward-mode Jacobian: ``benchmarks.gauss_newton``.

Paper-size problem: 20 000 transitions, 2-6-4-2 tanh network, RK4, float64. Then the two maps that
follow the angle, the default's splines and the convex network: what an evaluation costs. Then what
windows that estimate their starts add to it, without and with dead time.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problem import Problem, median_time, paper_problem, paper_recording, problem_of
from penode.arrays import float64
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime as PlantDeadTime
from penode.bench.inverter import Inverter
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.windows import Windows
from penode.pmsm.balance.start import weak_start
from penode.pmsm.machine.dead_time import DeadTime
from penode.training.loss import DEFAULT_LOSS, Loss
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
        seconds[kind] = timed_evaluation(kind, problem)
    print(f"coenergy over convex {seconds['coenergy'] / seconds['convex']:.1f}x")


def starts_that_are_estimated() -> None:
    """Print what estimating the starts costs, on noisy drives without and with dead time."""
    reference = Lissajous(240.0, 14.0, 15.0)
    print("Starts, spline map with the angle orders 6 and 12, 20 000 transitions, H = 40")
    for terms, name, dead in (
        ((), "no dead time", None),
        ((DeadTime(),), "dead time", PlantDeadTime(0.5e-6)),
    ):
        drive = Drive(current_noise=0.05, inverter=Inverter(dead_time=dead))
        run = simulate(
            TRACTION_300A, reference, speed_rpm=1500.0, duration=2.0, drive=drive, seed=1
        )
        machine = weak_start([run], "coenergy", terms=terms, angle_orders=(6, 12)).machine
        estimated = Loss(free_starts={"i_d": 1.0, "i_q": 1.0})
        fixed, free = (
            timed_evaluation(f"{name}, {way}", problem_of(run, machine, loss=loss), within)
            # One step to a start leaves squares right to a millionth, and slopes to its root.
            for way, loss, within in (
                ("measured", DEFAULT_LOSS, 1e-4),
                ("estimated", estimated, 1e-3),
            )
        )
        print(f"estimated over measured {free / fixed:.2f}x")


def timed_evaluation(name: str, problem: Problem, within: float = 1e-4) -> float:
    """Return and print what an evaluation costs in s, after a check of its descent."""
    objective, raw, windows = problem.objective, problem.raw, problem.windows(40)
    way = 1e-7 * np.random.default_rng(0).normal(size=len(raw))
    terms = objective.gauss_newton(raw, windows)
    ahead, behind = (objective.gauss_newton(raw + s * way, windows).loss for s in (1.0, -1.0))
    error = abs((ahead - behind) / 2 / (-2 * terms.descent @ way / terms.count) - 1)
    if error > within:
        raise SystemExit(f"{name}: the descent differs by {error:.1e}; nothing is timed.")
    seconds = median_time(lambda: objective.gauss_newton(raw, windows))
    print(
        f"{name:>23} {len(raw):4d} parameters {1e3 * seconds:7.1f} ms of processor"
        f"   descent agrees to {error:.0e}"
    )
    return seconds


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
    starts_that_are_estimated()


if __name__ == "__main__":
    main()
