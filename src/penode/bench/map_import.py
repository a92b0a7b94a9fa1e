"""Makes a machine of the bench from a user's own flux map, or from what an identification wrote."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.bench.coenergy_fit import SplineFit, fit_splines
from penode.bench.coenergy_table import CoenergyTable, SplineCoenergy
from penode.bench.flux_table import FluxTable, read_flux_table
from penode.bench.machines import Machine
from penode.bench.map_checks import MapChecks, check_map
from penode.errors import InputError

# A reciprocity residual above this share of the mean inductance, and an asymmetry or a part of psi
# left out above this share of the largest psi, are reported.
_WARNED_SHARE = 0.01

# Disc, over the current limit, on which the machine has to be invertible.
_INVERTIBLE_REACH = 1.2

# Verdicts under which R and the map must not be used.
_DOUBTFUL = ("no plateau", "not identifiable", "implausible")


@dataclass(frozen=True)
class MapFindings(SplineFit):
    """What is known about an imported map and what became of it."""

    # Reciprocity, symmetry and coverage of the map as it came.
    checks: MapChecks
    # Eigenvalue of L within 1.2 times the current limit, at any angle, H.
    smallest_inductance: float
    # A sentence for each finding that makes the machine differ from the map.
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class ImportedMachine:
    """A machine and what was found on the way.

    Its temperature coefficients, voltage and speed are the defaults; change them with
    `dataclasses.replace`.
    """

    machine: Machine
    findings: MapFindings


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
        CSV, npz or mat file; `penode.bench.flux_table` lists the names of columns it may use.
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
        ``machine``, and ``findings`` with ``warnings``, a sentence each.

    Raises
    ------
    InputError
        If the file holds no usable flux map, a number is not above zero, the angles cannot resolve
        the orders, or the machine would not be invertible where the map covers it.
    """
    if not (resistance >= 0 and pole_pairs >= 1 and (current_limit is None or current_limit > 0)):
        raise InputError(
            f"{path}: resistance {resistance} ohm, {pole_pairs} pole pairs and current limit "
            f"{current_limit} A; give a resistance not below zero, the others above it."
        )
    table = read_flux_table(path, pole_pairs=pole_pairs)
    checks = check_map(table)
    covered = table.covered
    reach = float(min(np.abs(axis[covered]).max() for axis in (table.i_d, table.i_q)))
    limit = reach if current_limit is None else current_limit
    fit = fit_splines(table, limit, orders, mirror)
    smallest = _smallest_inductance(fit.table, limit)
    _refuse_not_invertible(table, fit)
    warnings = tuple(_warnings(table, checks, fit, smallest, mirror))
    findings = MapFindings(
        **vars(fit), checks=checks, smallest_inductance=smallest, warnings=warnings
    )
    return ImportedMachine(_machine(table, fit.table, resistance, pole_pairs, limit), findings)


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
    with float64():
        rest = coenergy.mean(jnp.zeros(2), jnp.zeros(()))
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
    if fit.fit_error > _WARNED_SHARE * largest:
        warnings.append(f"the machine differs from the map by {1e3 * fit.fit_error:.3g} mVs rms")
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


def identified_machine(
    folder: str | Path,
    *,
    resistance: float | None = None,
    pole_pairs: int | None = None,
    current_limit: float | None = None,
    inductance_d: float | None = None,
    inductance_q: float | None = None,
) -> ImportedMachine:
    """Make a machine of ``flux_map.csv`` and ``result.json`` in a folder.

    Parameters
    ----------
    folder : str or Path
        Folder that ``penode identify`` wrote.
    resistance : float, optional
        In ohm; by default the one identified.
    pole_pairs : int, optional
        By default those given to the identification.
    current_limit : float, optional
        Largest permitted current, peak value, in A; by default the largest that the map covers
        along the axis it covers less.
    inductance_d, inductance_q : float, optional
        In H, of the data sheet: what the current controller is tuned from; by default those of the
        map at no current.

    Returns
    -------
    ImportedMachine
        Named after the folder, without harmonics of the angle. A doubtful verdict is a warning.

    Raises
    ------
    InputError
        If a file is missing or not what an identification of a machine writes, if the pole
        pairs are not given, or the map is unusable (see `import_machine`).
    """
    folder = Path(folder)
    source = folder / "flux_map.csv"
    result = _read_result(folder / "result.json")
    if not source.is_file():
        raise InputError(f"{source}: no such file; give a folder that penode identify wrote.")
    _require_same_result(source, result)
    if pole_pairs is None:
        pole_pairs = result.get("provenance", {}).get("pole_pairs")
    if pole_pairs is None:
        raise InputError(
            f"{folder}: the identification was not given the pole pairs; add pole_pairs = N beside "
            "result."
        )
    data_sheet = {"inductance_d": inductance_d, "inductance_q": inductance_q}
    given: dict[str, Any] = {k: value for k, value in data_sheet.items() if value is not None}
    for name, value in given.items():
        if not value > 0:
            raise InputError(f"{folder}: {name} must be > 0 H, got {value}.")
    verdict, doubts = result.get("horizon", {}).get("verdict"), list[str]()
    if resistance is None:
        resistance = _resistance(folder, result)
        if verdict in _DOUBTFUL:
            doubts.append(f"the verdict of {folder} is {verdict!r}: its R and its map are doubtful")
    imported = import_machine(
        source, resistance=resistance, pole_pairs=pole_pairs, current_limit=current_limit
    )
    warnings = (*doubts, *imported.findings.warnings)
    return ImportedMachine(
        replace(imported.machine, name=folder.resolve().name, **given),
        replace(imported.findings, warnings=warnings),
    )


def _read_result(path: Path) -> Mapping[str, Any]:
    try:
        result = json.loads(path.read_text())
    except OSError as error:
        raise InputError(
            f"{path}: no such file; give a folder that penode identify wrote."
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error}); identify again.") from error
    if not isinstance(result, dict):
        raise InputError(f"{path}: not a result of penode identify; give its folder.")
    return result


def _require_same_result(source: Path, result: Mapping[str, Any]) -> None:
    """Refuse a map other than the one that the result was written with."""
    files = result.get("files")
    digest = files.get(source.name) if isinstance(files, dict) else None
    if digest is not None and digest != hashlib.sha256(source.read_bytes()).hexdigest():
        raise InputError(
            f"{source}: not the file that result.json beside it was written with; put back the one "
            "that was, or run the identification again."
        )


def _resistance(folder: Path, result: Mapping[str, Any]) -> float:
    try:
        return float(result["parameters"]["R"]["value"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{folder}: result.json has no R; add resistance, in ohm, beside result."
        ) from error
