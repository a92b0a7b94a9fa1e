"""The default identification, whole, with its answer beside its time; and others that are told."""

import time

import numpy as np

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

#: What the data decide; without the terms of a real drive; and the smaller model of the paper.
STUDIES = {
    "decided from the data": Study(),
    "drive known": Study(candidates=(), hold="dq"),
    "map of i alone": Study(candidates=(), angle_orders=()),
}
ROUNDS = 3


def timed(run: Experiment, study: Study) -> tuple[float, Fit]:
    """Return the seconds that an identification takes, and its fit."""
    began = time.perf_counter()
    fit = identify([run], study=study)
    return time.perf_counter() - began, fit


def main() -> None:
    """Print time and error of the default identification, first cold and then compiled."""
    run = simulate(TRACTION_300A, Lissajous(240.0, 14.0, 15.0), speed_rpm=1500.0, duration=2.0)
    print("Default identification, 2 s at 10 kHz, whole ladder to H = 450")
    cold = {name: timed(run, study)[0] for name, study in STUDIES.items()}
    warm: dict[str, list[float]] = {name: [] for name in STUDIES}
    for _ in range(ROUNDS):
        for name, study in STUDIES.items():
            seconds, fit = timed(run, study)
            warm[name].append(seconds)
            if len(warm[name]) == ROUNDS:
                error = 100 * (fit.parameters["R"].value / TRACTION_300A.resistance - 1)
                told = f"H = {fit.horizon.selected}, R error {error:+.2f} %"
                each = f"cold {cold[name]:5.1f} s, warm {np.median(warm[name]):5.1f} s"
                print(f"{name:>22}, {each}   {told}")
    decided, known, _ = warm.values()
    ratios = sorted(a / b for a, b in zip(decided, known, strict=True))
    print(f"decided over drive known, {ROUNDS} rounds: {', '.join(f'{r:.2f}x' for r in ratios)}")


if __name__ == "__main__":
    main()
