"""The problem benchmarks share: the paper's 20 000 transitions, 2-6-4-2 tanh network, RK4."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.experiment import Experiment
from penode.data.windows import Contiguous, Windows, cut
from penode.pmsm.balance.start import weak_start
from penode.pmsm.machine.model import Machine
from penode.predictors.base import DEFAULT_SOLVER, Predictor
from penode.predictors.solver import Solver
from penode.training.loss import DEFAULT_LOSS, Loss
from penode.training.residuals import Objective

REPEATS = 5
#: Processor time of this process, s: on one core the wall time less what other processes take.
clock = time.process_time
#: Largest relative difference of losses and gradients that counts as agreement.
TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class Problem:
    """A recording, a machine started by the weak form, and the objective between them."""

    run: Experiment
    machine: Machine
    objective: Objective
    raw: FloatArray

    def windows(self, horizon: int) -> Windows:
        """Return contiguous windows over the whole recording."""
        machine = self.machine
        return cut([self.run], machine.states, machine.inputs, horizon, placement=Contiguous())


def problem_of(
    run: Experiment, machine: Machine, solver: Solver = DEFAULT_SOLVER, loss: Loss = DEFAULT_LOSS
) -> Problem:
    """Return the problem of a recording and a machine."""
    objective = Objective(Predictor(run.time_step, solver), machine, np.ones(2), loss)
    return Problem(run, machine, objective, objective.layout.raw(machine))


def paper_recording(duration: float = 2.0) -> Experiment:
    """Simulate the paper's recording: 2 s at 10 kHz, 1500 rpm."""
    reference = Lissajous(240.0, 14.0, 15.0)
    return simulate(TRACTION_300A, reference, speed_rpm=1500.0, duration=duration)


def paper_problem(solver: Solver = DEFAULT_SOLVER) -> Problem:
    """Start the paper's network on the paper's recording."""
    run = paper_recording()
    return problem_of(run, weak_start([run], "mlp")[0], solver)


def median_time(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the median time of a call in s, after one call to compile."""
    call()
    times = []
    for _ in range(repeats):
        began = clock()
        call()
        times.append(clock() - began)
    return statistics.median(times)


def check(name: str, found: tuple[float, FloatArray], wanted: tuple[float, FloatArray]) -> float:
    """Return the largest relative difference of loss and gradient, or refuse to go on."""
    gap = np.abs(found[1] - wanted[1]).max() / np.abs(wanted[1]).max()
    error = max(abs(found[0] / wanted[0] - 1), float(gap))
    if not error < TOLERANCE:
        raise SystemExit(f"{name}: loss or gradient differs by {error:.1e}; nothing is timed.")
    return error


def verdict(reached: bool) -> str:
    """Return the word for a goal."""
    return "reached" if reached else "MISSED"
