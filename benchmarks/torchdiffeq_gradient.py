"""Loss and gradient against torchdiffeq.

``taskset -c 0 python -m benchmarks.torchdiffeq_gradient`` where benchmarks/requirements.txt is
installed. Both sides: the same recording in contiguous windows, all of them one batch, the same 57
parameters, Kutta's 3/8 rule at one step a sample, float64, one thread. torchdiffeq runs in three
ways: eager with the network's Jacobian written out, the same compiled by torch.compile, and eager
with the Jacobian by torch.func, as it is commonly written. Nothing is timed unless loss and
gradient agree.
"""

import signal
import time
from collections.abc import Callable

import torch

from benchmarks.problem import Problem, check, median_time, paper_problem, verdict
from benchmarks.torch_problem import (
    by_torch_func,
    closed_form,
    cramer,
    derivative_of,
    loss_and_gradient,
)
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import RK4_38

HORIZONS = (1, 50, 100, 200)
COMPILE_S = 60
#: Least ratios asked for, by way of writing it and horizon.
GOALS = {("analytic", 1): 3, ("analytic", 50): 15, ("analytic", 200): 30, ("torch.func", 100): 100}


def out_of_time(*_: object) -> None:
    """Give up a compilation."""
    raise TimeoutError(f"not compiled within {COMPILE_S} s")


def try_to_compile(problem: Problem, horizon: int) -> tuple[Callable | None, str]:
    """Return the compiled derivative, or None, and a sentence on how it went."""
    compiled = torch.compile(derivative_of(problem, closed_form, cramer), dynamic=False)
    began = time.perf_counter()
    signal.signal(signal.SIGALRM, out_of_time)
    signal.alarm(COMPILE_S)
    try:
        loss_and_gradient(problem, problem.windows(horizon), compiled)()
    except Exception as why:
        return None, f"torch.compile is left out: {type(why).__name__}: {str(why)[:200]}"
    finally:
        signal.alarm(0)
    return compiled, f"torch.compile took {time.perf_counter() - began:.0f} s at H = {horizon}"


def main() -> None:
    """Print agreement, times and ratios."""
    torch.set_num_threads(1)
    problem = paper_problem(RungeKutta(RK4_38))
    ways: dict[str, Callable] = {
        "analytic": derivative_of(problem, closed_form, cramer),
        "torch.func": derivative_of(problem, by_torch_func, torch.linalg.solve),
    }
    compiled, sentence = try_to_compile(problem, HORIZONS[-1])
    if compiled:
        ways["compiled"] = compiled
    print("Loss and gradient, 57 parameters, 20 000 transitions, float64, medians of 5")
    print(f"torch {torch.__version__}, one thread; {sentence}")
    print(f"{'H':>4} {'penode':>10}" + "".join(f"{name:>22}" for name in ways))
    for horizon in HORIZONS:
        print_row(problem, horizon, ways)


def print_row(problem: Problem, horizon: int, ways: dict[str, Callable]) -> None:
    """Check and time one horizon."""
    windows = problem.windows(horizon)
    wanted = problem.objective.loss_and_gradient(problem.raw, windows)
    ours = median_time(lambda: problem.objective.loss_and_gradient(problem.raw, windows))
    row, worst, verdicts = f"{horizon:4d} {1e3 * ours:7.1f} ms", 0.0, []
    for name, derivative in ways.items():
        evaluate = loss_and_gradient(problem, windows, derivative)
        worst = max(worst, check(f"{name}, H = {horizon}", evaluate(), wanted))
        theirs = median_time(evaluate)
        row += f"{1e3 * theirs:10.1f} ms {theirs / ours:7.1f}x"
        goal = GOALS.get((name, horizon))
        if goal:
            verdicts.append(f"{name} {goal}x {verdict(theirs / ours >= goal)}")
    print(f"{row}   agree to {worst:.0e}  {', '.join(verdicts)}", flush=True)


if __name__ == "__main__":
    main()
