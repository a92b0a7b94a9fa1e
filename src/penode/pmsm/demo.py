"""The whole story on the built-in machine, whose truth is known: record, identify, compare."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from penode.bench.coenergy_table import true_flux_map
from penode.bench.machines import TRACTION_300A, Machine
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.experiment import Experiment
from penode.data.save import save
from penode.fit.fit import Fit
from penode.horizon.ladder import Observer, ignore_events
from penode.pmsm.comparison.map_comparison import compare_maps
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.study import identify


@dataclass(frozen=True, eq=False)
class Demo:
    """A fit beside the truth.

    `machine` is what was recorded, `truth` its flux map over the current disc. ``flux_error`` is
    the mean absolute error of psi_d and psi_q over the excited region in Vs.
    """

    fit: Fit
    machine: Machine
    truth: FluxGrid
    flux_error: float

    @property
    def flux_share(self) -> float:
        """``flux_error`` as a share of the magnet's flux linkage."""
        return self.flux_error / self.machine.magnet_flux_linkage


def record(folder: Path) -> tuple[Experiment, tuple[Experiment, ...]]:
    """Simulate the paper's hard recording and two others, write them as CSV, and return them.

    The first, ``train_1500rpm.csv``, is to train on, the others are to validate with.
    """
    machine = TRACTION_300A
    slow = Lissajous(0.8 * machine.current_limit, rate_d=14.0, rate_q=15.0)
    other = Lissajous(0.7 * machine.current_limit, rate_d=40.0, rate_q=33.0)
    runs = {
        "train_1500rpm.csv": simulate(machine, slow, speed_rpm=1500.0, duration=2.0),
        "test_900rpm.csv": simulate(machine, other, speed_rpm=900.0, duration=0.6),
        "test_2500rpm.csv": simulate(machine, other, speed_rpm=2500.0, duration=0.6),
    }
    named = [
        Experiment(name, run.time_step, run.channels, run.source) for name, run in runs.items()
    ]
    for experiment in named:
        save(experiment, folder / experiment.name)
    return named[0], tuple(named[1:])


def run_demo(folder: Path, observer: Observer = ignore_events) -> Demo:
    """Record into a folder, identify, and compare with the truth that was never seen."""
    train, validation = record(folder)
    machine = TRACTION_300A
    fit = identify([train], pole_pairs=machine.pole_pairs, validation=validation, observer=observer)
    truth = _truth(machine, np.abs(fit.excited).max())
    error = float(np.nanmean(np.abs(compare_maps(fit, truth).difference)))
    return Demo(fit, machine, truth, error)


def _truth(machine: Machine, limit: float) -> FluxGrid:
    """Return R and flux map of a machine for currents up to a limit in A on both axes."""
    axis = np.linspace(-limit, limit, 61)
    psi = np.moveaxis(true_flux_map(machine, axis[:, None], axis), -1, 0)
    everywhere = np.ones((len(axis), len(axis)), dtype=bool)
    nowhere = np.full((2, 2, *everywhere.shape), np.nan)
    return FluxGrid(axis, axis, psi, nowhere, everywhere, machine.resistance)
