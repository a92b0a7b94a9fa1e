"""Forward pass, gradient and Gauss-Newton terms, and how far they are from what a core can do.

``taskset -c 0 python -m benchmarks.roofline``. The least time is the larger of computing
(operations at the rate of a matrix product, tanh at its own) and of moving bytes. The rates are
measured first, in the same run, on the same core; `benchmarks.operations` counts the operations.
Gradient and terms are held against each other: reverse mode and forward sensitivities share no
derivative code. The distance is the measured time in least times.
"""

import os
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.operations import Work, gauss_newton, gradient, transition
from benchmarks.problem import Problem, check, median_time, paper_problem, verdict
from penode.arrays import float64
from penode.data.windows import Windows
from penode.training.residuals import compiled_windows

HORIZONS = (1, 50, 200)
SIZES = (2, 6, 4, 2)
#: Goals: gradients in forward passes, terms in gradients, distance of the gradient at H = 50.
GRADIENT, TERMS, DISTANCE = 5, 5, 4


@dataclass(frozen=True)
class Core:
    """Rates of one core: operations, evaluations of tanh and bytes, each a second."""

    operations: float
    tanh: float
    bytes: float

    def least(self, work: Work) -> float:
        """Return the least time in s for some work."""
        computing = work.operations / self.operations + work.tanh / self.tanh
        return max(computing, work.bytes / self.bytes)


def measured_core() -> Core:
    """Measure this core: a product of matrices, tanh of an array, both in cache, and a copy."""
    size, repeats = 256, 50
    with float64():
        matrix = jnp.ones((size, size)) / size
        flat = jnp.linspace(-2.0, 2.0, 2**13)

        @jax.jit
        def products(a):
            return jax.lax.fori_loop(0, repeats, lambda _, b: a @ b, a)

        @jax.jit
        def tanhs(x):
            return jax.lax.fori_loop(0, repeats, lambda _, y: jnp.tanh(y), x)

        by_jax = median_time(lambda: products(matrix).block_until_ready()) / repeats
        tanh = median_time(lambda: tanhs(flat).block_until_ready()) / repeats
    plain, out = np.asarray(matrix), np.empty((size, size))
    by_numpy = median_time(lambda: [np.matmul(plain, plain, out=out) for _ in range(repeats)])
    source, target = np.ones(2**24), np.ones(2**24)
    copying = median_time(lambda: np.copyto(target, source))
    return Core(
        operations=2 * size**3 / min(by_jax, by_numpy / repeats),
        tanh=len(flat) / tanh,
        bytes=2 * source.nbytes / copying,
    )


def agreement(problem: Problem, windows: Windows) -> float:
    """Return the largest relative difference between reverse mode and forward sensitivities."""
    terms = problem.objective.gauss_newton(problem.raw, windows)
    summed = (terms.loss, -2 * terms.descent / terms.count)
    return check("reverse", problem.objective.loss_and_gradient(problem.raw, windows), summed)


def forward_time(problem: Problem, windows: Windows) -> float:
    """Return the time of the loss alone in s: what is left of the same program without gradient."""
    whole = problem.objective.loss_and_gradient_of
    loss = jax.jit(lambda *of: whole(*of)[0], static_argnums=2)
    with float64():
        batch = compiled_windows(problem.objective.error, windows, len(windows.starts))
        raw = jnp.asarray(problem.raw)
        return median_time(lambda: loss(raw, batch, windows.horizon).block_until_ready())


def print_row(problem: Problem, core: Core, horizon: int) -> None:
    """Check and time one horizon."""
    windows = problem.windows(horizon)
    error, forward = agreement(problem, windows), forward_time(problem, windows)
    objective, raw, count = problem.objective, problem.raw, len(windows.starts) * horizon
    slope = median_time(lambda: objective.loss_and_gradient(raw, windows))
    terms = median_time(lambda: objective.gauss_newton(raw, windows))
    least = [core.least(work.times(count)) for work in works(len(raw))]
    far = [t / limit for t, limit in zip((forward, slope, terms), least, strict=True)]
    print(
        f"{horizon:4d} {1e3 * forward:8.1f} ms {1e3 * slope:8.1f} ms {1e3 * terms:8.1f} ms"
        f" {slope / forward:8.1f}x {terms / slope:8.1f}x"
        f" {far[0]:8.1f}x {far[1]:8.1f}x {far[2]:8.1f}x   agree to {error:.0e}"
    )
    words = [
        f"gradient within {GRADIENT} forward passes {verdict(slope / forward <= GRADIENT)}",
        f"terms within {TERMS} gradients {verdict(terms / slope <= TERMS)}",
    ]
    if horizon == 50:
        words.append(f"gradient within {DISTANCE}x of the least {verdict(far[1] < DISTANCE)}")
    print("     " + ", ".join(words), flush=True)


def works(parameters: int) -> tuple[Work, ...]:
    """Return the work of one transition: forward, with gradient, with Gauss-Newton terms."""
    return transition(SIZES), gradient(SIZES), gauss_newton(SIZES, parameters)


def main() -> None:
    """Print the core, the work, and times with their distances."""
    if len(os.sched_getaffinity(0)) > 1:
        print("More than one core is allowed: rates and times may use them all; use taskset.")
    problem, core = paper_problem(), measured_core()
    print(
        f"this core: {core.operations / 1e9:.1f} Gflop/s, {core.tanh / 1e6:.0f} million tanh/s, "
        f"{core.bytes / 1e9:.1f} GB/s"
    )
    count = len(problem.run) - 1
    for name, work in zip(("forward", "gradient", "terms"), works(len(problem.raw)), strict=True):
        whole = work.times(count)
        print(
            f"{name:>9}: {whole.operations / 1e6:6.1f} Mflop, {whole.tanh / 1e6:.2f} million tanh, "
            f"{whole.bytes / 1e6:.1f} MB: at least {1e3 * core.least(whole):.2f} ms"
        )
    print(f"{count} transitions, float64, medians of 5; distance: measured time / least time")
    print(
        f"{'H':>4} {'forward':>11} {'gradient':>11} {'terms':>11} {'grad/fwd':>9} {'terms/gr':>9}"
        f" {'distance':>9} {'gradient':>9} {'terms':>9}"
    )
    for horizon in HORIZONS:
        print_row(problem, core, horizon)


if __name__ == "__main__":
    main()
