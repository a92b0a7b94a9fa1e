"""The paper's training of sixteen seeds: ``python -m benchmarks.parallel_starts [SECONDS]``.

At each of twelve horizons the seeds train side by side in one program. On a processor that costs
what training them one by one costs; an accelerator, which one seed leaves idle, takes hardly longer
for sixteen.
Run on both, the whole times of the two runs are the comparison; within one run the ratio to seeds
trained alone is printed. The first seed alone must end where it ends among the others.
"""

import sys
import time
from collections.abc import Sequence

import jax
import numpy as np

from benchmarks.problem import paper_recording
from penode.arrays import FloatArray
from penode.horizon.ladder import LadderProblem
from penode.paper.conventional.trained_methods import PaperRecipe
from penode.pmsm.balance.start import nominal_start
from penode.training.first_order import FirstOrder
from penode.training.plan import Problem

HORIZONS = (1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 90, 135)
SEEDS = 16
EPOCHS = 5
DURATION = 0.4
#: Adam divides by the root of its second moments: rounding in a gradient grows.
AGREEMENT = 1e-6


def train(stages: list[tuple[FirstOrder, Problem]], raws: FloatArray) -> FloatArray:
    """Return where starts (start, parameter) end, (horizon, start, parameter)."""
    ends = [optimiser.minimise_together(problem, raws) for optimiser, problem in stages]
    return np.array([[solution.raw for solution in solutions] for solutions in ends])


def main(
    duration: float = DURATION, horizons: Sequence[int] = HORIZONS, seeds: int = SEEDS
) -> None:
    """Print the times of the whole sweep and of one seed's part of it."""
    run = paper_recording(duration)
    starts = [nominal_start([run], seed) for seed in range(seeds)]
    plans = [PaperRecipe(h, EPOCHS, growth=()).plan for h in horizons]
    ascent = LadderProblem.of(starts[0], [run], plans[0], lambda event: None)
    stages = [(p.stages[0].optimiser, ascent.problem(p.stages[0], p)) for p in plans]
    raws = np.stack([ascent.objective.layout.raw(start) for start in starts])

    def timed(count: int) -> tuple[FloatArray, float]:
        train(stages, raws[:count])  # compiles
        began = time.perf_counter()
        return train(stages, raws[:count]), time.perf_counter() - began

    together, whole = timed(seeds)
    alone, single = timed(1)
    gap = np.abs(together[:, :1] - alone).max() / np.abs(alone).max()
    if not gap < AGREEMENT:
        raise SystemExit(f"parameters differ by {gap:.1e} from alone; nothing is timed.")
    print(f"{jax.devices()[0].device_kind}: {len(run)} samples, {EPOCHS} epochs of 20 batches")
    print(f"{len(horizons)} horizons x {seeds} seeds: {whole:.1f} s, one seed: {single:.1f} s")
    print(f"one by one / together: {seeds * single / whole:.1f}x; agreement {gap:.0e}")


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
