"""The error of an identified map, and how much of it its band covers."""

import numpy as np

from penode.arrays import FloatArray
from penode.bench.coenergy_table import true_flux_map
from penode.bench.machines import Machine
from penode.fit.fit import Fit
from penode.pmsm.result_files import GRID


def rectangle(fit: Fit) -> FloatArray:
    """Return a grid over the rectangle around the excited region, shape (point, 2), A."""
    low, high = fit.excited.min(axis=0), fit.excited.max(axis=0)
    axes = [np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def error_and_coverage(fit: Fit, machine: Machine) -> tuple[float, float]:
    """Return the mean absolute error over the largest |psi|, and the fraction within the band.

    Both over the grid points inside the excited region, of the mean map over the angle.
    """
    grid = rectangle(fit)
    inside = grid[fit.supported(grid)]
    psi = np.asarray(true_flux_map(machine, *inside.T)).reshape(len(inside), 2)
    gap = np.abs(fit.flux_map(*inside.T).T - psi)
    band = fit.learned_uncertainty.deviation(fit.model, inside)
    return float(gap.mean() / np.hypot(*psi.T).max()), float(np.mean(gap < 1.96 * band))
