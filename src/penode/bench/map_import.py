"""Makes a machine of the bench from a user's own flux map."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.bench.coenergy_fit import SplineFit, fit_splines
from penode.bench.coenergy_table import CoenergyTable, SplineCoenergy
from penode.bench.flux_table import FluxTable
from penode.bench.machines import Machine
from penode.bench.map_checks import MapChecks, check_map
from penode.bench.map_files import csv, mat, npz
from penode.bench.map_layouts import flux_table
from penode.errors import InputError

#: Readers by the suffix of the file.
MAP_READERS: dict[str, Callable[[Path], dict[str, NDArray[Any]]]] = {
    ".csv": csv.read,
    ".npz": npz.read,
    ".mat": mat.read,
}

# A reciprocity residual above this share of the mean inductance, and an asymmetry or a part of psi
# left out above this share of the largest psi, are reported.
_WARNED_SHARE = 0.01

# Disc, over the current limit, on which the machine has to be invertible.
_INVERTIBLE_REACH = 1.2


@dataclass(frozen=True)
class MapFindings:
    """What is known about an imported map and what became of it.

    Attributes
    ----------
    checks : MapChecks
        Reciprocity, symmetry and coverage of the map as it came.
    fit_error : float
        rms of psi between the map and the machine in Vs, over points, angles and axes; it contains
        the part of the map that is not reciprocal and the harmonics left out.
    orders : tuple of int
        Harmonics of the electrical angle that the machine has.
    left_out : float
        rms of the part of psi over the angle in other orders in Vs.
    skew : float
        s in H of the map's part s J i, which no coenergy has; (resistance error) / (electrical
        speed) where the map was measured at one speed. It is left out of the machine.
    smallest_inductance : float
        Smallest eigenvalue of L within 1.2 times the current limit, at any angle, in H.
    warnings : tuple of str
        A sentence for each finding that makes the machine differ from the map.
    """

    checks: MapChecks
    fit_error: float
    orders: tuple[int, ...]
    left_out: float
    skew: float
    smallest_inductance: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class ImportedMachine:
    """A machine and what was found on the way.

    Attributes
    ----------
    machine : Machine
        Its temperature coefficients, voltage and speed are the defaults; change them with
        `dataclasses.replace`.
    findings : MapFindings
        What the map is like and how well the machine reproduces it.
    """

    machine: Machine
    findings: MapFindings


def read_flux_table(path: str | Path, *, pole_pairs: int) -> FluxTable:
    """Read a flux map from a CSV, npz or mat file; `map_layouts` lists the names it may use.

    The pole pairs are for angles that the file has in mechanical degrees.
    """
    path = Path(path)
    reader = MAP_READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: a flux map in a {path.suffix or 'file without suffix'} is not known; give "
            f"one of {', '.join(MAP_READERS)}."
        )
    return flux_table(str(path), reader(path), pole_pairs)


def import_machine(
    path: str | Path,
    *,
    resistance: float,
    pole_pairs: int,
    current_limit: float | None = None,
    orders: tuple[int, ...] | None = None,
    mirror: bool = False,
) -> ImportedMachine:
    """Make a machine of a flux map, by a least-squares coenergy of quintic splines.

    The machine is reciprocal, in the angle too, whether the map is or not; what that changes is
    reported. Outside the covered region L is continued smoothly, as far as it can towards constant.

    Parameters
    ----------
    path : str or Path
        CSV, npz or mat file, see `read_flux_table`.
    resistance : float
        Resistance of one phase in ohm.
    pole_pairs : int
        Number of pole pairs.
    current_limit : float, optional
        Largest permitted current, peak value, in A; by default the largest that the map covers
        along the axis it covers less.
    orders : tuple of int, optional
        Harmonics of the electrical angle to keep; by default those of 6, 12 and 18 that the angles
        can resolve.
    mirror : bool
        Add the map's mirror image in i_q, for a map that covers one sign of i_q.

    Returns
    -------
    ImportedMachine

    Raises
    ------
    InputError
        If the file holds no usable flux map (see `read_flux_table`, `check_map`), a number is not
        above zero, the angles cannot resolve the orders, or the machine would not be invertible
        where the map covers it.
    OSError
        If the file cannot be opened.
    """
    if not (resistance >= 0 and pole_pairs >= 1 and (current_limit is None or current_limit > 0)):
        raise InputError(
            f"{path}: resistance {resistance} ohm, {pole_pairs} pole pairs and current limit "
            f"{current_limit} A; give a resistance not below zero, the others above it."
        )
    table = read_flux_table(path, pole_pairs=pole_pairs)
    checks = check_map(table)
    limit = _covered_current(table) if current_limit is None else current_limit
    fit = fit_splines(table, limit, orders, mirror)
    smallest = _smallest_inductance(fit.table, limit)
    _refuse_not_invertible(table, fit)
    machine = _machine(table, fit.table, resistance, pole_pairs, limit)
    findings = MapFindings(
        checks=checks,
        fit_error=fit.error,
        orders=fit.table.orders,
        left_out=fit.left_out,
        skew=fit.skew,
        smallest_inductance=smallest,
        warnings=tuple(_warnings(table, checks, fit, smallest, mirror)),
    )
    return ImportedMachine(machine, findings)


def _covered_current(table: FluxTable) -> float:
    """Return the smaller of the largest covered |i_d| and |i_q| in A."""
    covered = table.covered
    return float(min(np.abs(axis[covered]).max() for axis in (table.i_d, table.i_q)))


def _inductance_at(table: CoenergyTable, currents: FloatArray) -> FloatArray:
    """Return the eigenvalues of L at currents (point, 2) over 60 degrees, (point, angle, 2)."""
    angles = np.linspace(0.0, np.pi / 3, 24, endpoint=False) if table.orders else np.zeros(1)
    with float64():
        inductance = np.asarray(_inductance(table, on_device(currents), on_device(angles)))
    eigenvalues: FloatArray = np.linalg.eigvalsh(inductance)
    return eigenvalues


@jax.jit
def _inductance(table: CoenergyTable, currents: JaxArray, angles: JaxArray) -> JaxArray:
    """Return L of all pairs of currents (point, 2) and angles, (point, angle, 2, 2)."""
    look_up = jax.vmap(jax.vmap(table, (None, 0)), (0, None))
    return look_up(currents, angles).inductance


def _smallest_inductance(table: CoenergyTable, limit: float) -> float:
    """Return the smallest eigenvalue of L on the disc on which it matters in H."""
    radius = np.linspace(0.0, _INVERTIBLE_REACH * limit, 25)[:, None]
    turn = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
    disc = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1).reshape(-1, 2)
    return float(_inductance_at(table, disc).min())


def _refuse_not_invertible(table: FluxTable, fit: SplineFit) -> None:
    """Raise if L of the fitted coenergy is not positive definite at a point of the map."""
    covered = table.covered
    points = np.stack([table.i_d[covered], table.i_q[covered]], axis=1)
    points = points[np.abs(points).max(axis=1) <= fit.table.reach]
    smallest = _inductance_at(fit.table, points).min(axis=(1, 2))
    if smallest.min() <= 0:
        i_d, i_q = points[smallest.argmin()]
        raise InputError(
            f"{table.name}: the reciprocal map closest to this one cannot be inverted at "
            f"i_d = {i_d:.4g} A, i_q = {i_q:.4g} A; smooth the map there, or leave the region out."
        )


def _machine(
    table: FluxTable, coenergy: CoenergyTable, resistance: float, pole_pairs: int, limit: float
) -> Machine:
    """Return the machine; its data-sheet values are those at no current."""
    mean = CoenergyTable(coenergy.coefficients[..., :1], coenergy.spacing, ())
    with float64():
        rest = mean(jnp.zeros(2), jnp.zeros(()))
    return Machine(
        name=Path(table.name).stem,
        resistance=resistance,
        pole_pairs=pole_pairs,
        current_limit=limit,
        magnet_flux_linkage=float(rest.linkage[0]),
        inductance_d=float(rest.inductance[0, 0]),
        inductance_q=float(rest.inductance[1, 1]),
        angle_orders=coenergy.orders,
        coenergy=SplineCoenergy(coenergy),
    )


def _warnings(
    table: FluxTable, checks: MapChecks, fit: SplineFit, smallest: float, mirror: bool
) -> list[str]:
    """Return a sentence for each finding worth one."""
    covered = table.covered
    largest = float(np.hypot(table.psi_d[covered], table.psi_q[covered]).max())
    warnings = []
    if checks.reciprocity_residual > _WARNED_SHARE * fit.mean_inductance:
        warnings.append(
            f"the map is not reciprocal by {1e6 * checks.reciprocity_residual:.3g} uH rms; "
            "the machine is, and so differs from it"
        )
    if checks.asymmetry is not None and checks.asymmetry > _WARNED_SHARE * largest:
        warnings.append(
            f"the map differs from its mirror image in i_q by {1e3 * checks.asymmetry:.3g} mVs "
            "rms; its frame may be turned, or the d axis not lie on the magnet"
        )
    if checks.i_q_range[0] * checks.i_q_range[1] >= 0 and not mirror:
        warnings.append("the map covers one sign of i_q; the other is extrapolated, not mirrored")
    if fit.error > _WARNED_SHARE * largest:
        warnings.append(f"the machine differs from the map by {1e3 * fit.error:.3g} mVs rms")
    if fit.left_out > _WARNED_SHARE * largest:
        warnings.append(
            f"{1e3 * fit.left_out:.3g} mVs rms of psi lie in orders of the angle that were left out"
        )
    if smallest <= 0:
        warnings.append(
            f"L is not positive definite everywhere within {_INVERTIBLE_REACH} times the current "
            "limit; stay inside the map, or lower the current limit"
        )
    return warnings
