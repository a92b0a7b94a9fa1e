"""A flux map as it came: psi on a grid of currents and angles, read from a file of named arrays.

Names are compared without case, underscores and spaces. Known are penode's own (``i_d, i_q,
theta_el, psi_d, psi_q``), SyR-e's ``fdfq_idiq`` (``Id, Iq, Fd, Fq``) and ``motorModel``, vectors
and matrices for Simulink (``idVec, iqVec, angleVec, fluxD, fluxQ`` and kin), Motor-CAD's saturation
map (``Id_Peak, Iq_Peak`` or ``Stator_Current_Phase_Peak, Phase_Advance``, and ``Flux_Linkage_D`` or
``Angular_Flux_Linkage_D``) and motulator's complex ``i_s_dq, psi_s_dq``.
"""

import contextlib
import csv
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from penode.arrays import BoolArray, FloatArray
from penode.errors import InputError

Arrays: TypeAlias = Mapping[str, NDArray[Any]]

_CURRENT = ("i{}", "i{}vec", "i{}veca", "i{}peak", "i{}axis", "is{}")
_FLUX = ("psi{}", "flux{}", "f{}", "flux{}wb", "fluxlinkage{}", "angularfluxlinkage{}", "lambda{}")
# The first in rad, the others in degrees, electrical and mechanical.
_ANGLE_RAD, _ANGLE_EL, _ANGLE_MECH = "thetael", "angularrotorposition", ("anglevec", "anglevecdeg")
_LEAST_POINTS = 5
_LEAST_FILLED = 0.25
_EMPTY = ("", "nan", "NaN", "NA")


@dataclass(frozen=True)
class FluxTable:
    """Flux linkage over a grid of currents, straight or polar, and the electrical angle.

    Currents (row, column) are peak values of a phase in A, angles (angle,) in rad, one for a
    map without angle; psi (row, column, angle) in Vs is NaN where the map has no value.
    """

    name: str
    i_d: FloatArray
    i_q: FloatArray
    theta_el: FloatArray
    psi_d: FloatArray
    psi_q: FloatArray

    @property
    def covered(self) -> BoolArray:
        """Where psi is given at every angle, shape (row, column)."""
        return np.asarray(~np.isnan(self.psi_d + self.psi_q).any(axis=2))


def read_flux_table(path: str | Path, *, pole_pairs: int) -> FluxTable:
    """Read a flux map from a CSV, npz or mat file; pole pairs are for mechanical angles."""
    path = Path(path)
    reader = MAP_READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: a flux map must be one of {', '.join(MAP_READERS)}, got "
            f"{path.suffix or 'a file without suffix'}."
        )
    return flux_table(str(path), reader(path), pole_pairs)


def _read_csv(path: Path) -> Arrays:
    """Return the numeric columns, NaN in empty cells; columns of text are left out."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = list(filter(None, csv.reader(file)))
        reason = "empty" if not lines else _uneven(lines)
    except (csv.Error, UnicodeDecodeError) as error:
        reason = str(error)
    if reason:
        raise InputError(
            f"{path}: not a table of comma-separated values ({reason}); write one header line and "
            "as many cells in each row."
        )
    numeric: dict[str, FloatArray] = {}
    for name, *cells in zip(*lines, strict=True):
        with contextlib.suppress(ValueError):
            numeric[name.strip()] = np.array(
                [np.nan if cell.strip() in _EMPTY else float(cell) for cell in cells]
            )
    if not numeric:
        raise InputError(f"{path}: no column holds numbers only; a flux map in SI was wanted.")
    return numeric


def _uneven(lines: list[list[str]]) -> str:
    """Return which row has another number of cells than the first, empty if none."""
    count = len(lines[0])
    rows = (
        f"row {k} has {len(x)} cells of {count}" for k, x in enumerate(lines) if len(x) != count
    )
    return next(rows, "")


def _read_npz(path: Path) -> Arrays:
    """Return the arrays of a NumPy archive; nothing pickled is loaded."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (ValueError, AttributeError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(
            f"{path}: not a NumPy archive of numbers; write it with numpy.savez."
        ) from error


def _read_mat(path: Path) -> Arrays:
    """Return the variables of a MATLAB file up to version 7, vectors with one axis.

    The fields of a struct are named after the field alone where no variable has that name. Of a
    machine as SyR-e saves it (``motorModel``) the map of currents and fluxes is returned.
    """
    with path.open("rb") as file:
        has_header = file.read(6) == b"MATLAB"
    try:
        if not has_header:
            raise ValueError("no MATLAB header")
        variables = loadmat(path, struct_as_record=False, squeeze_me=True)
    except NotImplementedError as error:
        raise InputError(
            f"{path}: a MATLAB file of version 7.3; save it with '-v7' instead."
        ) from error
    except (ValueError, TypeError, IndexError, MatReadError, OSError, zlib.error) as error:
        raise InputError(f"{path}: not a MATLAB file; save it from MATLAB with '-v7'.") from error
    model = variables.get("motorModel")
    if "FluxMap_dq" in getattr(model, "_fieldnames", []):
        return _of_syre(model)
    arrays: dict[str, NDArray[Any]] = {}
    for struct in variables.values():
        fields = getattr(struct, "_fieldnames", [])
        arrays |= {field: np.asarray(getattr(struct, field)) for field in fields}
    return arrays | {name: np.asarray(v) for name, v in variables.items() if name[0] != "_"}


def _of_syre(model: Any) -> Arrays:
    """Return SyR-e's map; synchronous reluctance axes have d where the inductance is largest."""
    grid = model.FluxMap_dq
    i_d, i_q, psi_d, psi_q = (np.asarray(getattr(grid, name)) for name in ("Id", "Iq", "Fd", "Fq"))
    if getattr(getattr(model, "data", None), "axisType", "PM") == "SR":
        i_d, i_q, psi_d, psi_q = -i_q, i_d, -psi_q, psi_d
    return {"i_d": i_d, "i_q": i_q, "psi_d": psi_d, "psi_q": psi_q}


#: Readers by the suffix of the file.
MAP_READERS: dict[str, Callable[[Path], Arrays]] = {
    ".csv": _read_csv,
    ".npz": _read_npz,
    ".mat": _read_mat,
}


def flux_table(file: str, arrays: Arrays, pole_pairs: int) -> FluxTable:
    """Make a flux table of named arrays; pole pairs are for angles in mechanical degrees.

    Currents are vectors of a grid, grids of the shape of the fluxes, or, with all arrays of one
    axis, one point a row; at least 5 points along an axis.
    """
    numbers = {name: values for name, values in arrays.items() if values.dtype.kind in "biufc"}
    named = {key.lower().replace("_", "").replace(" ", ""): numbers[key] for key in numbers}
    for stem, key in (("i", "isdq"), ("psi", "psisdq")):
        if key in named:
            named |= {stem + "d": named[key].real, stem + "q": named[key].imag}
    i_d, i_q = _currents(file, named)
    psi_d, psi_q = (_first(file, named, _FLUX, axis) for axis in "dq")
    theta = _angles(named, pole_pairs)
    if psi_d.shape != psi_q.shape:
        raise InputError(
            f"{file}: psi_d has shape {psi_d.shape} and psi_q {psi_q.shape}; give both on one grid."
        )
    make = _from_rows if psi_d.ndim == 1 else _from_grids
    table = make(file, i_d, i_q, theta, (psi_d, psi_q))
    if min(table.i_d.shape) < _LEAST_POINTS:
        raise InputError(
            f"{file}: the map has {' x '.join(map(str, table.i_d.shape))} points; at least "
            f"{_LEAST_POINTS} currents along either axis are wanted."
        )
    return table


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
    known = [form.format(axis) for form in forms]
    for name in known:
        if name in named:
            return np.asarray(named[name], dtype=np.float64)
    raise InputError(
        f"{file}: found {', '.join(sorted(named)) or 'no numbers'}, but none of "
        f"{', '.join(known)}; rename the {axis} axis's "
        f"{'currents' if forms is _CURRENT else 'flux linkages'} to one of them."
    )


def _angles(named: Arrays, pole_pairs: int) -> FloatArray:
    """Return the electrical angles in rad as the file has them; one angle 0 where it has none."""
    if _ANGLE_RAD in named:
        return np.asarray(named[_ANGLE_RAD], dtype=np.float64)
    if _ANGLE_EL in named:
        positions = np.asarray(named[_ANGLE_EL], dtype=np.float64)
        return np.asarray(np.deg2rad(positions.reshape(-1, positions.shape[-1])[0]))
    for key in _ANGLE_MECH:
        if key in named:
            return np.asarray(np.deg2rad(named[key].astype(np.float64)) * pole_pairs)
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
    seen = np.zeros([len(axis) for axis in axes], dtype=int)
    np.add.at(seen, places, 1)
    if seen.max() > 1:
        raise InputError(f"{file}: a point (i_d, i_q, theta_el) is listed twice; list it once.")
    if seen.mean() < _LEAST_FILLED:
        raise InputError(
            f"{file}: {count} points fill {seen.mean():.0%} of the grid of their currents and "
            "angles; sample the map on a grid of i_d and i_q."
        )
    psi_d, psi_q = np.full((2, *seen.shape), np.nan)
    psi_d[places], psi_q[places] = psi
    i_d, i_q = np.meshgrid(axes[0], axes[1], indexing="ij")
    return FluxTable(file, i_d, i_q, axes[2], psi_d, psi_q)
