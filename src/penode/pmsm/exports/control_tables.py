"""Tables for control made of a machine's map: currents of flux linkages, and of torques."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from penode.arrays import BoolArray, FloatArray
from penode.fit.fit import Fit
from penode.pmsm.control.controlled_machine import ControlledMachine, largest_current
from penode.pmsm.control.inversion import inverse
from penode.pmsm.control.loci import backed_current, mtpa, supported_torques
from penode.pmsm.control.operating_points import mtpa_of_torque
from penode.pmsm.machine.flux_grid import FluxGrid

#: Torques at which the cells of a table are looked at, and what counts as the same torque.
_FINE, _ROUNDING = 1001, 1e-9


@dataclass(frozen=True, eq=False)
class InverseMap:
    """Currents over an even grid of flux linkages.

    Attributes
    ----------
    psi_d, psi_q : ndarray, shape (row,) and (column,)
        Vs, rising, over the flux linkages of the supported region.
    current : ndarray, shape (2, row, column)
        i_d and i_q in A.
    supported : ndarray of bool, shape (row, column)
        Where recordings have been.
    """

    psi_d: FloatArray
    psi_q: FloatArray
    current: FloatArray
    supported: BoolArray


@dataclass(frozen=True, eq=False)
class TorquePerAmpere:
    """The least current of torques, of each sign as far as recordings support it.

    Attributes
    ----------
    torque : ndarray, shape (point,)
        Nm, even, rising, zero among them.
    current : ndarray, shape (2, point)
        i_d and i_q in A.
    supported : str
        The ranges of torque, Nm, at which the map's table is supported: there may be holes.
    """

    torque: FloatArray
    current: FloatArray
    supported: str


def inverse_map(fit: Fit, grid: FluxGrid) -> InverseMap:
    """Return i(psi) with as many points a side as the grid has rows.

    The corners of its rectangle may belong to currents beyond the grid, or to none: they hold what
    was found, or the nearest point of the table, and are not supported.
    """
    flux, current = grid.psi.reshape(2, -1), grid.mesh.reshape(2, -1)
    inside = flux[:, grid.supported.ravel()] if grid.supported.any() else flux
    count = len(grid.i_d)
    axes = [np.linspace(one.min(), one.max(), count) for one in inside]
    targets = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(2, -1)
    nearest = current[:, cKDTree(flux.T).query(targets.T)[1]]
    currents = inverse(
        lambda i: fit.flux_map(*i), lambda i: fit.differential_inductance(*i), targets, nearest
    )
    reach = np.array([np.ptp(grid.i_d), np.ptp(grid.i_q)])[:, None]
    lost = ~(np.abs(currents - nearest) <= reach).all(axis=0)
    currents = np.where(lost, nearest, currents)
    supported = fit.supported(currents.T) & ~lost
    shape = (count, count)
    return InverseMap(axes[0], axes[1], currents.reshape(2, *shape), supported.reshape(shape))


def torque_per_ampere(fit: Fit, grid: FluxGrid) -> TorquePerAmpere | None:
    """Return MTPA, of points as many as the grid has rows or more; None without pole pairs.

    Of the sign that recordings support further the largest torque is among them, and of the other
    nearly: as many points are taken as make it so.
    """
    if grid.pole_pairs is None:
        return None
    machine = ControlledMachine.of(fit, grid.pole_pairs)
    sides = (machine, machine.mirrored())
    largest = largest_current(fit)
    limits = [backed_current(side, largest) for side in sides]
    most = [
        float(mtpa(side, np.array([limit])).torque[0])
        for side, limit in zip(sides, limits, strict=True)
    ]
    fewest = math.ceil((len(grid.i_d) - 1) * max(most) / sum(most))
    shares = [min(most) / max(most) * count + _ROUNDING for count in range(fewest, 2 * fewest)]
    cells = fewest + int(np.argmin([share % 1.0 / share for share in shares]))
    step = max(most) / cells
    counts = [math.floor(one / step + _ROUNDING) for one in most]
    each: list[FloatArray] = [np.asarray(step * np.arange(count + 1)) for count in counts]
    motoring, mirrored = (
        mtpa_of_torque(side, torque, limit)
        for side, torque, limit in zip(sides, each, limits, strict=True)
    )
    braking = (mirrored * np.array([[1.0], [-1.0]]))[:, :0:-1]
    torque = np.concatenate([-each[1][:0:-1], each[0]])
    current = np.concatenate([braking, motoring], axis=1)
    fine = np.linspace(torque[0], torque[-1], _FINE)
    between = np.stack([np.interp(fine, torque, one) for one in current])
    return TorquePerAmpere(torque, current, supported_torques(fine, _in_cells(grid, between)))


def _in_cells(grid: FluxGrid, current: FloatArray) -> BoolArray:
    """Return which currents (2, point), A, lie in cells of a table with four supported corners."""
    place = []
    for axis, one in zip((grid.i_d, grid.i_q), current, strict=True):
        cell = np.floor((one - axis[0]) / (axis[-1] - axis[0]) * (len(axis) - 1))
        place.append(np.clip(cell, 0, len(axis) - 2).astype(int))
    d, q = place
    corners = [grid.supported[d + i, q + j] for i in (0, 1) for j in (0, 1)]
    return np.asarray(np.all(corners, axis=0))
