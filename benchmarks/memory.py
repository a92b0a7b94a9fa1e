"""Peak memory of loss and gradient and of Gauss-Newton terms: ``python -m benchmarks.memory``.

Every figure is the peak resident memory of a process of its own, less that of the same call on 1000
samples, which has the interpreter, the libraries and the compiler in it. The longer recordings
repeat the paper's samples end to end. Accuracy first: the terms of a recording in pieces must sum
to those of the whole.
"""

import pickle
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.problem import Problem, paper_problem, problem_of, verdict
from penode.arrays import FloatArray
from penode.data.experiment import Experiment

HORIZONS = (1, 10, 50, 200)
SAMPLES = (100_000, 300_000, 1_000_000)
FEW, MANY, PIECE = 1_001, 10_000_001, 500_000
#: Most that a million samples may take, in MB.
BUDGET = 2000
TOLERANCE = 1e-10
#: Growth that still counts as none in H and as linear in the samples.
SLACK = 1.2


def gradient(problem: Problem, horizon: int) -> None:
    """Evaluate loss and gradient."""
    problem.objective.loss_and_gradient(problem.raw, problem.windows(horizon))


def terms(problem: Problem, horizon: int) -> None:
    """Evaluate the Gauss-Newton terms."""
    problem.objective.gauss_newton(problem.raw, problem.windows(horizon))


def streamed(problem: Problem, horizon: int) -> None:
    """Evaluate the Gauss-Newton terms piece by piece."""
    in_pieces(problem, horizon, PIECE)


def in_pieces(problem: Problem, horizon: int, size: int) -> FloatArray:
    """Return the sum of S'S over pieces of the recording; its windows if `horizon` divides size."""
    normal = np.zeros((len(problem.raw), len(problem.raw)))
    for first in range(0, len(problem.run) - 1, size):
        part = {n: v[first : first + size + 1] for n, v in problem.run.channels.items()}
        piece = replace(problem, run=replace(problem.run, channels=part))
        normal += piece.objective.gauss_newton(problem.raw, piece.windows(horizon)).normal
    return normal


CALLS: dict[str, Callable[[Problem, int], None]] = {
    "gradient": gradient,
    "terms": terms,
    "streamed": streamed,
}


def measure(file: str, call: str, horizon: str, samples: str) -> None:
    """Do one call on so many samples and print this process's peak in MB."""
    time_step, channels, machine = pickle.loads(Path(file).read_bytes())
    longer = {name: np.resize(values, int(samples)) for name, values in channels.items()}
    CALLS[call](problem_of(Experiment("repeated", time_step, longer), machine), int(horizon))
    print(own_peak())


def own_peak() -> float:
    """Return this process's peak in MB."""
    # Not getrusage: its peak is inherited from the process that started this one.
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s*(\d+) kB", status)[1]) * 1024 / 1e6


def peak(file: Path, call: str, horizon: int, samples: int) -> float:
    """Return the peak of a call in MB above that of the same call on few samples."""
    peaks = []
    for count in (samples, FEW):
        command = [sys.executable, "-m", "benchmarks.memory", str(file), call]
        done = subprocess.run(
            [*command, str(horizon), str(count)], stdout=subprocess.PIPE, check=True
        )
        peaks.append(float(done.stdout))
    return peaks[0] - peaks[1]


def check(problem: Problem) -> None:
    """Refuse to go on unless pieces sum to the whole."""
    whole = problem.objective.gauss_newton(problem.raw, problem.windows(200)).normal
    error = np.abs(in_pieces(problem, 200, 5000) - whole).max() / np.abs(whole).max()
    if error > TOLERANCE:
        raise SystemExit(f"S'S of pieces differs by {error:.1e}; nothing is measured.")
    print(f"Peak memory in MB above a process with {FEW} samples; pieces agree to {error:.0e}")


def print_row(name: str, peaks: list[float], sentence: str) -> None:
    """Print one line of figures."""
    print(
        f"{name:>10}" + "".join(f"{value:10.0f}" for value in peaks) + f"   {sentence}", flush=True
    )


def over_horizons(file: Path) -> None:
    """Print the peaks at 100 000 samples over the horizon."""
    print(f"{SAMPLES[0]} samples, H =" + "".join(f"{h:10d}" for h in HORIZONS))
    for call in ("gradient", "terms"):
        peaks = [peak(file, call, horizon, SAMPLES[0]) for horizon in HORIZONS]
        grown = peaks[-1] / peaks[0]
        print_row(call, peaks, f"H = 200 / H = 1: {grown:.2f}, no growth {verdict(grown <= SLACK)}")


def over_samples(file: Path) -> None:
    """Print the peaks at H = 200 over the number of samples."""
    print("H = 200, samples" + "".join(f"{n:10d}" for n in SAMPLES))
    for call in ("gradient", "terms"):
        peaks = [peak(file, call, HORIZONS[-1], samples) for samples in SAMPLES]
        linear = peaks[-1] / peaks[0] <= SLACK * SAMPLES[-1] / SAMPLES[0]
        words = f"linear {verdict(linear)}, below {BUDGET} MB {verdict(peaks[-1] < BUDGET)}"
        print_row(call, peaks, words)
        shortest = peak(file, call, HORIZONS[0], SAMPLES[-1])
        words = f"H = 1, {SAMPLES[-1]} samples, below {BUDGET} MB {verdict(shortest < BUDGET)}"
        print_row(call, [shortest], words)


def main() -> None:
    """Print the peaks over horizons and samples."""
    problem = paper_problem()
    check(problem)
    channels = {name: problem.run.channels[name] for name in names(problem)}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.pickle"
        file.write_bytes(pickle.dumps((problem.run.time_step, channels, problem.machine)))
        over_horizons(file)
        over_samples(file)
        many = peak(file, "streamed", HORIZONS[-1], MANY)
        own = MANY * len(channels) * 8 / 1e6
    print(f"{MANY} samples in pieces of {PIECE}: {many:.0f} MB, of which {own:.0f} the recording")


def names(problem: Problem) -> tuple[str, ...]:
    """Return the channels that the machine needs."""
    return (*problem.machine.states, *problem.machine.inputs)


if __name__ == "__main__":
    measure(*sys.argv[1:]) if sys.argv[1:] else main()
