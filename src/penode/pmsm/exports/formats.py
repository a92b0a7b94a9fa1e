"""The formats a flux map can be exported to."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.fit.fit import Fit
from penode.pmsm.exports import (
    c_header,
    excel,
    mat,
    matlab_script,
    motorcad,
    npz,
    onnx,
    syre,
)
from penode.pmsm.exports.control_tables import (
    InverseMap,
    TorquePerAmpere,
    inverse_map,
    torque_per_ampere,
)
from penode.pmsm.exports.matlab_tables import over_turn, variables
from penode.pmsm.machine.angle_grid import over_angle
from penode.pmsm.machine.flux_grid import FluxGrid, tabulate
from penode.pmsm.result_files import flux_map_csv


@dataclass(frozen=True)
class Format:
    """One way to write a flux map: ``encode(fit, grid, name)`` gives a file's content.

    ``name`` is that of the file, ``reader`` who reads it; ``points`` a side of the grid where no
    other number is asked for.
    """

    reader: str
    suffix: str
    encode: Callable[[Fit, FluxGrid, str], str | bytes]
    points: int = 41


def _control(fit: Fit, grid: FluxGrid) -> tuple[InverseMap, TorquePerAmpere | None]:
    return inverse_map(fit, grid), torque_per_ampere(fit, grid)


def _variables(fit: Fit, grid: FluxGrid) -> dict[str, Any]:
    return variables(grid, *_control(fit, grid))


def _mat(fit: Fit, grid: FluxGrid, name: str) -> bytes:
    return mat.encode(_variables(fit, grid) | over_turn(over_angle(fit, grid)))


#: To add a format, add one entry. CSV keeps the grid of ``flux_map.csv``.
FORMATS: dict[str, Format] = {
    "csv": Format("any program", ".csv", lambda fit, grid, name: flux_map_csv(fit)),
    "npz": Format("motulator", ".npz", lambda fit, grid, name: npz.encode(grid)),
    "mat": Format("Simulink, Simscape", ".mat", _mat),
    "m": Format(
        "MATLAB", ".m", lambda fit, grid, name: matlab_script.encode(_variables(fit, grid))
    ),
    "motorcad": Format(
        "Motor-CAD's readers",
        ".mat",
        lambda fit, grid, name: mat.encode(motorcad.variables(grid, over_angle(fit, grid))),
    ),
    "xlsx": Format(
        "Excel", ".xlsx", lambda fit, grid, name: excel.encode(grid, torque_per_ampere(fit, grid))
    ),
    "syre": Format("SyR-e", ".mat", lambda fit, grid, name: syre.encode(grid), points=256),
    "c": Format(
        "C99, float",
        ".h",
        lambda fit, grid, name: c_header.encode(grid, name, *_control(fit, grid)),
    ),
    "c_fixed": Format(
        "C99, 16 bits",
        ".h",
        lambda fit, grid, name: c_header.encode(grid, name, *_control(fit, grid), fixed=True),
    ),
    "onnx": Format("ONNX Runtime", ".onnx", lambda fit, grid, name: onnx.encode(fit, grid)),
}


#: A side; a table has as many values as the square of it, and a C header a word for each.
_MOST_POINTS = 2000


def export(
    fit: Fit,
    to: str,
    path: str | Path,
    *,
    points: int | None = None,
    pole_pairs: int | None = None,
) -> FluxGrid:
    """Write a machine's flux map for another program.

    Parameters
    ----------
    fit : Fit
        Of a machine.
    to : str
        A key of `FORMATS`.
    path : str or Path
        Replaced in one step; its suffix is that of the format.
    points : int, optional
        Points a side of the grid.
    pole_pairs : int, optional
        For the torque; overrides what the fit says.

    Returns
    -------
    FluxGrid
        The table written: even, over the excited range, zero exactly among its currents.

    Raises
    ------
    InputError
        If the format or the suffix is not known, the points are too many or too few, or the format
        cannot hold this map.
    """
    path = Path(path)
    if to not in FORMATS:
        known = ", ".join(f"{name} ({one.reader})" for name, one in FORMATS.items())
        raise InputError(f"format must be one of {known}, got {to!r}.")
    target = FORMATS[to]
    if path.suffix.lower() != target.suffix:
        raise InputError(
            f"{path}: suffix must be {target.suffix!r} for the format {to}, got {path.suffix!r}."
        )
    if points is not None and to == "csv":
        raise InputError("the format csv has the grid of flux_map.csv; leave the points out.")
    if points is not None and points > _MOST_POINTS:
        raise InputError(f"points a side must be <= {_MOST_POINTS}, got {points}.")
    grid = tabulate(fit, target.points if points is None else points, pole_pairs)
    write_atomically(path, target.encode(fit, grid, path.stem))
    return grid
