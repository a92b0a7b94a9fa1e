"""What a flux map as it came can and cannot be used for: refused, or reported, never repaired."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from penode.arrays import BoolArray, FloatArray
from penode.bench.flux_table import FluxTable
from penode.errors import InputError

# Share of the points with q current that need a mirror image before symmetry is judged.
_MIRRORED_SHARE = 0.2


@dataclass(frozen=True)
class MapChecks:
    """What the checks found in a usable map."""

    # rms of d psi_d/d i_q - d psi_q/d i_d over cells and angles, H.
    reciprocity_residual: float
    # rms to the mirror image in i_q, Vs; None where less than a fifth of the points have one.
    asymmetry: float | None
    # Share of the grid's points that have values.
    covered_share: float
    # Smallest and largest covered current, A.
    i_d_range: tuple[float, float]
    i_q_range: tuple[float, float]


def check_map(table: FluxTable) -> MapChecks:
    """Check coverage, invertibility, reciprocity and symmetry.

    A hole in the covered region, or a cell whose inductance is not positive definite, is
    refused.
    """
    covered = table.covered
    _refuse_holes(table, covered)
    inductance, cells = cell_inductance(table)
    _refuse_singular(table, inductance, cells)
    residual = (inductance[..., 0, 1] - inductance[..., 1, 0])[cells]
    return MapChecks(
        reciprocity_residual=float(np.sqrt(np.mean(residual**2))),
        asymmetry=_asymmetry(table, covered),
        covered_share=float(covered.mean()),
        i_d_range=(float(table.i_d[covered].min()), float(table.i_d[covered].max())),
        i_q_range=(float(table.i_q[covered].min()), float(table.i_q[covered].max())),
    )


def cell_inductance(table: FluxTable) -> tuple[FloatArray, BoolArray]:
    """Return L (row - 1, column - 1, angle, 2, 2), H, of each cell, and which cells are known.

    Differential, row psi, column current; NaN in cells without four known corners and an area.
    """
    current = np.stack([table.i_d, table.i_q], axis=-1)[:, :, None, :]
    flux = np.stack([table.psi_d, table.psi_q], axis=-1)
    by_current, by_flux = _cell_slopes(current), _cell_slopes(flux)
    area = np.abs(np.linalg.det(by_current[:, :, 0]))
    covered = table.covered
    corners = covered[1:, 1:] & covered[1:, :-1] & covered[:-1, 1:] & covered[:-1, :-1]
    cells: BoolArray = corners & (area > 1e-9 * area.max())
    inductance = np.full(by_flux.shape, np.nan)
    inductance[cells] = by_flux[cells] @ np.linalg.inv(by_current[cells])
    return inductance, cells


def _cell_slopes(values: FloatArray) -> FloatArray:
    """Return the slopes along rows and columns in each cell, (row - 1, column - 1, angle, 2, 2)."""
    down, right = np.diff(values, axis=0), np.diff(values, axis=1)
    return np.stack([(down[:, 1:] + down[:, :-1]) / 2, (right[1:] + right[:-1]) / 2], axis=-1)


def _refuse_holes(table: FluxTable, covered: BoolArray) -> None:
    """Raise if a point without values lies between points with values in its row and column."""
    if not covered.any():
        raise InputError(f"{table.name}: no point of the map has values at every angle.")
    between = np.ones_like(covered)
    for axis in (0, 1):
        before = np.logical_or.accumulate(covered, axis=axis)
        after = np.flip(np.logical_or.accumulate(np.flip(covered, axis), axis=axis), axis)
        between &= before & after
    holes = between & ~covered
    if holes.any():
        row, column = np.argwhere(holes)[0]
        raise InputError(
            f"{table.name}: {holes.sum()} points inside the covered region have no values, the "
            f"first at i_d = {table.i_d[row, column]:.4g} A, i_q = {table.i_q[row, column]:.4g} A; "
            "fill them in at the source, or leave out the rows that hold them."
        )


def _refuse_singular(table: FluxTable, inductance: FloatArray, cells: BoolArray) -> None:
    """Raise if L is not positive definite in a cell with values."""
    if not cells.any():
        raise InputError(
            f"{table.name}: no cell of the grid has four corners with values and an area; give psi "
            "on a grid that is ordered by its currents."
        )
    determinant = np.linalg.det(inductance[cells])
    singular = ~((determinant > 0) & (inductance[cells][..., 0, 0] > 0)).all(axis=1)
    if singular.any():
        row, column = np.argwhere(cells)[singular][0]
        raise InputError(
            f"{table.name}: psi cannot be inverted in {singular.sum()} of {singular.size} cells "
            f"(det L <= 0 or L_dd <= 0), the first at i_d = {table.i_d[row, column]:.4g} A, "
            f"i_q = {table.i_q[row, column]:.4g} A; look for a transposed matrix, swapped axes, "
            "another sign convention or outliers, and correct the map at its source."
        )


def _asymmetry(table: FluxTable, covered: BoolArray) -> float | None:
    """Return the rms of the mean map's difference to its mirror image in i_q in Vs."""
    points = np.stack([table.i_d[covered], table.i_q[covered]], axis=1)
    flux = np.stack([table.psi_d[covered].mean(axis=1), table.psi_q[covered].mean(axis=1)], axis=1)
    scale = np.abs(points).max()
    loaded = np.abs(points[:, 1]) > 1e-6 * scale
    distance, partner = cKDTree(points).query(points * [1.0, -1.0])
    paired = loaded & (distance < 1e-6 * scale)
    if paired.sum() < _MIRRORED_SHARE * loaded.sum():
        return None
    mirrored = flux[partner] * [1.0, -1.0]
    return float(np.sqrt(np.mean((flux - mirrored)[paired] ** 2)))
