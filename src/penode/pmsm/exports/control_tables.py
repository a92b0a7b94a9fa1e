"""Tables for control made of a machine's map: currents of flux linkages, and of torques."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from penode.arrays import BoolArray, FloatArray
from penode.fit.fit import Fit
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.inversion import inverse
from penode.pmsm.control.loci import backed_current, mtpa, supported_torques
from penode.pmsm.control.operating_points import mtpa_of_torque
from penode.pmsm.machine.flux_grid import FluxGrid


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
    """The least current of torques, both signs, as far as recordings support it.

    Attributes
    ----------
    torque : ndarray, shape (point,)
        Nm, even, rising, from the negative of the largest.
    current : ndarray, shape (2, point)
        i_d and i_q in A.
    supported : ndarray of bool, shape (point,)
        Where recordings have been: between its ends there may be a hole.
    """

    torque: FloatArray
    current: FloatArray
    supported: BoolArray

    @property
    def supported_torques(self) -> str:
        """The ranges of torque, Nm, that recordings support, in words."""
        return supported_torques(self.torque, self.supported)


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
    """Return MTPA, as many points as the grid has rows; None where the pole pairs are not known."""
    if grid.pole_pairs is None:
        return None
    machine = ControlledMachine.of(fit, grid.pole_pairs)
    sides = (machine, machine.mirrored())
    largest = float(np.hypot(*fit.excited.T).max())
    limit = min(backed_current(side, largest) for side in sides)
    most = min(float(mtpa(side, np.array([limit])).torque[0]) for side in sides)
    half = len(grid.i_d) // 2
    torque = most * np.arange(half + 1) / half
    motoring, mirrored = (mtpa_of_torque(side, torque, limit) for side in sides)
    braking = (mirrored * np.array([[1.0], [-1.0]]))[:, :0:-1]
    current = np.concatenate([braking, motoring], axis=1)
    return TorquePerAmpere(
        np.concatenate([-torque[:0:-1], torque]), current, fit.supported(current.T)
    )
