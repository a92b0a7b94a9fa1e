"""Recognises a flux map among named arrays: which of them are the currents, angles and fluxes.

Names are compared without case, underscores and spaces. Known are penode's own (``i_d, i_q,
theta_el, psi_d, psi_q``), SyR-e's ``fdfq_idiq`` (``Id, Iq, Fd, Fq``; its ``motorModel`` comes under
these names from the reader), vectors and matrices for Simulink (``idVec, iqVec, angleVec, fluxD,
fluxQ`` and kin), Motor-CAD's saturation map (``Id_Peak, Iq_Peak`` or ``Stator_Current_Phase_Peak,
Phase_Advance``, and ``Flux_Linkage_D`` or ``Angular_Flux_Linkage_D``) and motulator's complex
``i_s_dq, psi_s_dq``.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from penode.arrays import FloatArray
from penode.bench.flux_table import FluxTable
from penode.errors import InputError

Arrays: TypeAlias = Mapping[str, NDArray[Any]]

_CURRENT = ("i{}", "i{}vec", "i{}veca", "i{}peak", "i{}axis", "is{}")
_FLUX = ("psi{}", "flux{}", "f{}", "flux{}wb", "fluxlinkage{}", "angularfluxlinkage{}", "lambda{}")
# Angles: name, and whether they are mechanical; all but the first are in degrees.
_ANGLE_RAD, _ANGLE_EL, _ANGLE_MECH = "thetael", "angularrotorposition", ("anglevec", "anglevecdeg")
_LEAST_POINTS = 5
_LEAST_FILLED = 0.25


def flux_table(file: str, arrays: Arrays, pole_pairs: int) -> FluxTable:
    """Make a flux table of named arrays; pole pairs are for angles in mechanical degrees.

    Currents are vectors of a grid, grids of the shape of the fluxes, or, with all arrays of one
    axis, one point a row; at least 5 points along an axis.
    """
    named = {key.lower().replace("_", "").replace(" ", ""): arrays[key] for key in arrays}
    named |= _split_complex(named)
    i_d, i_q = _currents(file, named)
    psi_d, psi_q = (_first(file, named, _FLUX, axis) for axis in "dq")
    theta = _angles(named, pole_pairs)
    if psi_d.shape != psi_q.shape:
        raise InputError(
            f"{file}: psi_d has shape {psi_d.shape} and psi_q {psi_q.shape}; give both on one grid."
        )
    if psi_d.ndim == 1:
        table = _from_rows(file, i_d, i_q, theta, (psi_d, psi_q))
    else:
        table = _from_grids(file, i_d, i_q, theta, (psi_d, psi_q))
    if min(table.i_d.shape) < _LEAST_POINTS:
        raise InputError(
            f"{file}: the map has {' x '.join(map(str, table.i_d.shape))} points; at least "
            f"{_LEAST_POINTS} currents along either axis are wanted."
        )
    return table


def _split_complex(named: Arrays) -> dict[str, NDArray[Any]]:
    """Return i_d, i_q, psi_d and psi_q of complex currents and fluxes (motulator)."""
    channels: dict[str, NDArray[Any]] = {}
    for stem, key in (("i", "isdq"), ("psi", "psisdq")):
        if key in named:
            channels |= {stem + "d": named[key].real, stem + "q": named[key].imag}
    return channels


def _currents(file: str, named: Arrays) -> tuple[FloatArray, FloatArray]:
    """Return i_d and i_q; polar currents (length, advance from the q axis in degrees) converted."""
    length, advance = named.get("statorcurrentphasepeak"), named.get("phaseadvance")
    cartesian = any(form.format("d") in named for form in _CURRENT)
    if length is not None and advance is not None and not cartesian:
        gamma, radius = np.radians(advance.astype(np.float64)), length.astype(np.float64)
        return np.asarray(-radius * np.sin(gamma)), np.asarray(radius * np.cos(gamma))
    return _first(file, named, _CURRENT, "d"), _first(file, named, _CURRENT, "q")


def _first(file: str, named: Arrays, forms: tuple[str, ...], axis: str) -> FloatArray:
    """Return the array of the first known name that is there."""
    for form in forms:
        if form.format(axis) in named:
            return np.asarray(named[form.format(axis)], dtype=np.float64)
    wanted = ", ".join(form.format(axis) for form in forms)
    raise InputError(
        f"{file}: found {', '.join(sorted(named)) or 'no numbers'}, but none of {wanted}; rename "
        f"the {axis} axis's {'currents' if forms is _CURRENT else 'flux linkages'} to one of them."
    )


def _angles(named: Arrays, pole_pairs: int) -> FloatArray:
    """Return the electrical angles in rad as the file has them; one angle 0 where it has none."""
    if _ANGLE_RAD in named:
        return np.asarray(named[_ANGLE_RAD], dtype=np.float64)
    if _ANGLE_EL in named:
        positions = np.asarray(named[_ANGLE_EL], dtype=np.float64)
        electrical: FloatArray = np.deg2rad(positions.reshape(-1, positions.shape[-1])[0])
        return electrical
    for key in _ANGLE_MECH:
        if key in named:
            mechanical: FloatArray = np.deg2rad(np.asarray(named[key], np.float64))
            return mechanical * pole_pairs
    return np.zeros(1)


def _from_grids(
    file: str, i_d: FloatArray, i_q: FloatArray, theta: FloatArray, psi: tuple[FloatArray, ...]
) -> FluxTable:
    """Make the table of fluxes on a grid, (i_d, i_q) or (i_q, i_d), with or without angle."""
    theta = np.atleast_1d(np.squeeze(theta))
    shape = psi[0].shape
    if i_d.ndim == 1 and i_q.ndim == 1:
        # A square matrix is read as (i_d, i_q); a transposed one cannot be inverted and is refused.
        transposed = shape[:2] != (len(i_d), len(i_q)) and shape[:2] == (len(i_q), len(i_d))
        i_d, i_q = np.meshgrid(i_d, i_q, indexing="xy" if transposed else "ij")
    deep = [values[..., None] if values.ndim == 2 else values for values in psi]
    if i_d.shape != shape[:2] or i_q.shape != shape[:2] or deep[0].shape[2] != len(theta):
        raise InputError(
            f"{file}: i_d {i_d.shape}, i_q {i_q.shape}, {len(theta)} angles and fluxes of shape "
            f"{shape} do not belong together; give psi as (i_d, i_q) or (i_d, i_q, theta_el)."
        )
    if not (np.isfinite(i_d).all() and np.isfinite(i_q).all() and np.isfinite(theta).all()):
        raise InputError(f"{file}: a current or angle is not finite; only fluxes may be missing.")
    return FluxTable(file, i_d, i_q, theta, deep[0], deep[1])


def _from_rows(
    file: str, i_d: FloatArray, i_q: FloatArray, theta: FloatArray, psi: tuple[FloatArray, ...]
) -> FluxTable:
    """Make the table of points listed in any order; points of the grid not listed are NaN."""
    count = len(psi[0])
    theta = np.broadcast_to(theta, count) if theta.size == 1 else theta
    if {len(i_d), len(i_q), len(theta)} != {count}:
        raise InputError(
            f"{file}: {len(i_d)} i_d, {len(i_q)} i_q, {len(theta)} theta_el and {count} psi do not "
            "belong together; give one of each a row."
        )
    axes, places = zip(
        *(np.unique(np.round(axis, 9), return_inverse=True) for axis in (i_d, i_q, theta)),
        strict=True,
    )
    if not all(np.isfinite(axis).all() for axis in axes):
        raise InputError(f"{file}: a current or angle is missing; only fluxes may be missing.")
    grids = [np.full([len(axis) for axis in axes], np.nan) for _ in psi]
    seen = np.zeros(grids[0].shape, dtype=int)
    np.add.at(seen, places, 1)
    if seen.max() > 1:
        raise InputError(f"{file}: a point (i_d, i_q, theta_el) is listed twice; list it once.")
    if seen.mean() < _LEAST_FILLED:
        raise InputError(
            f"{file}: {count} points fill {seen.mean():.0%} of the grid of their currents and "
            "angles; sample the map on a grid of i_d and i_q."
        )
    for grid, values in zip(grids, psi, strict=True):
        grid[places] = values
    i_d, i_q = np.meshgrid(axes[0], axes[1], indexing="ij")
    return FluxTable(file, i_d, i_q, axes[2], grids[0], grids[1])
