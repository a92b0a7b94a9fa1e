"""A machine's flux map on an even grid of currents that contains zero."""

import csv
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from penode.arrays import BoolArray, FloatArray
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.pmsm.machine.standstill import require_magnet
from penode.pmsm.machine.temperatures import UNKNOWN, Temperatures, temperatures_of

_COLUMNS = ("i_d", "i_q", "psi_d", "psi_q")
_LEAST_POINTS = 5


@dataclass(frozen=True, eq=False)
class FluxGrid:
    """A flux map as a table; between its points it is a bicubic spline.

    Attributes
    ----------
    i_d, i_q : ndarray, shape (row,) and (column,)
        Currents in A, rising.
    psi : ndarray, shape (2, row, column)
        psi_d and psi_q in Vs; NaN where a file has no value.
    inductance : ndarray, shape (2, 2, row, column)
        L = d psi / d i in H; NaN where a file has none.
    supported : ndarray of bool, shape (row, column)
        Where recordings have been; elsewhere the map is an extrapolation.
    resistance : float or None
        In ohm; None where it is not known.
    pole_pairs : int or None
        None if not given.
    temperatures : Temperatures
        That R and psi belong to.
    dead_time_voltage : float or None
        Of a phase in V, which an inverter takes beside R; None where none was identified.
    """

    i_d: FloatArray
    i_q: FloatArray
    psi: FloatArray
    inductance: FloatArray
    supported: BoolArray
    resistance: float | None = None
    pole_pairs: int | None = None
    temperatures: Temperatures = UNKNOWN
    dead_time_voltage: float | None = None

    @property
    def mesh(self) -> FloatArray:
        """i_d and i_q of every point in A, shape (2, row, column)."""
        return np.stack(np.meshgrid(self.i_d, self.i_q, indexing="ij"))

    @property
    def torque(self) -> FloatArray | None:
        """Torque 3/2 p (psi_d i_q - psi_q i_d) in Nm, shape (row, column); None without p."""
        if self.pole_pairs is None:
            return None
        (i_d, i_q), (psi_d, psi_q) = self.mesh, self.psi
        torque: FloatArray = 1.5 * self.pole_pairs * (psi_d * i_q - psi_q * i_d)
        return torque

    def flux_map(self, i_d: FloatArray, i_q: FloatArray) -> FloatArray:
        """Return psi (2, ...) in Vs at currents in A; beyond the grid, that of its edge."""
        return np.stack([spline.ev(i_d, i_q) for spline in self._splines])

    def differential_inductance(self, i_d: FloatArray, i_q: FloatArray) -> FloatArray:
        """Return the slope of `flux_map`, L (2, 2, ...) in H, at currents in A."""
        orders = ((1, 0), (0, 1))
        return np.stack([[s.ev(i_d, i_q, dx=d, dy=q) for d, q in orders] for s in self._splines])

    @cached_property
    def _splines(self) -> list[RectBivariateSpline]:
        return [RectBivariateSpline(self.i_d, self.i_q, one) for one in self.psi]


def even_axis(low: float, high: float, points: int) -> FloatArray:
    """Return evenly spaced currents around zero (points,), A, zero itself exactly among them.

    The range, low <= 0 <= high, is widened at one end so that zero is a point.
    """
    below = np.arange(points)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.nan_to_num([-low / below, high / below[::-1]], nan=0.0, posinf=np.inf)
    steps = needed.max(axis=0)
    zero = int(steps.argmin())
    axis: FloatArray = steps[zero] * (below - zero)
    return axis


def tabulate(fit: Fit, points: int, pole_pairs: int | None = None) -> FluxGrid:
    """Evaluate a machine's flux map over the excited range and zero.

    Parameters
    ----------
    fit : Fit
        Of a machine.
    points : int
        Points a side.
    pole_pairs : int, optional
        Overrides what the fit says.

    Returns
    -------
    FluxGrid
        Without the resistance where the recordings do not identify it.

    Raises
    ------
    InputError
        If there are fewer than 5 points a side, pole pairs below 1, a current was zero
        throughout, or the rotor stood still.
    """
    if points < _LEAST_POINTS:
        raise InputError(f"points a side must be >= {_LEAST_POINTS}, got {points}.")
    if pole_pairs is not None and pole_pairs < 1:
        raise InputError(f"pole_pairs must be >= 1, got {pole_pairs}.")
    require_magnet(fit)
    low, high = np.minimum(fit.excited.min(axis=0), 0), np.maximum(fit.excited.max(axis=0), 0)
    if not (high > low).all():
        raise InputError(
            "the recordings of this fit leave i_d or i_q at zero, and a map over both was wanted; "
            "identify with a recording that moves both."
        )
    i_d, i_q = (even_axis(a, b, points) for a, b in zip(low, high, strict=True))
    mesh = np.stack(np.meshgrid(i_d, i_q, indexing="ij"))
    stored_pole_pairs = fit.provenance.get("pole_pairs")
    known = fit.horizon.answered and "R" in fit.parameters
    dead_time = fit.parameters.get("dead_time_voltage")
    temperatures = temperatures_of(fit)
    return FluxGrid(
        i_d,
        i_q,
        fit.flux_map(*mesh),
        fit.differential_inductance(*mesh),
        fit.supported(mesh.reshape(2, -1).T).reshape(points, points),
        fit.parameters["R"].value if known else None,
        stored_pole_pairs if pole_pairs is None else pole_pairs,
        temperatures if known else temperatures.without_resistance().doubted(fit.horizon.verdict),
        dead_time.value if known and dead_time else None,
    )


def interpolation_error(fit: Fit, grid: FluxGrid) -> float:
    """Return by how much linear interpolation in a fit's table is off at most, Vs.

    The largest length of the error of psi at the middle of a cell with four supported corners;
    zero where there is none.
    """
    corners = np.lib.stride_tricks.sliding_window_view
    middle = corners(grid.mesh, (2, 2), (1, 2)).mean(axis=(-2, -1))
    between = corners(grid.psi, (2, 2), (1, 2)).mean(axis=(-2, -1))
    inside = corners(grid.supported, (2, 2)).all(axis=(-2, -1))
    error = np.hypot(*(fit.flux_map(*middle) - between))
    return float(error[inside].max(initial=0.0))


def read_grid(path: str | Path) -> FluxGrid:
    """Read a map with columns i_d, i_q (A), psi_d, psi_q (Vs) and, if there, supported (0 or 1).

    Parameters
    ----------
    path : str or Path
        CSV such as ``flux_map.csv``. Points of the grid that are not listed are NaN and not
        supported; without a column ``supported`` all listed ones are.

    Returns
    -------
    FluxGrid
        Without inductances.

    Raises
    ------
    InputError
        If the file is no such table, or its currents lie on no grid.
    """
    table = _read_columns(Path(path))
    (i_d, row), (i_q, column) = (
        np.unique(np.round(table[name], 9), return_inverse=True) for name in _COLUMNS[:2]
    )
    shape = (len(i_d), len(i_q))
    if min(shape) < _LEAST_POINTS or len(row) < shape[0] * shape[1] / 4:
        raise InputError(
            f"{path}: {len(row)} points on {shape[0]} values of i_d and {shape[1]} of i_q; "
            f"psi must lie on a grid of at least {_LEAST_POINTS} by {_LEAST_POINTS} currents."
        )
    psi, supported = np.full((2, *shape), np.nan), np.zeros(shape, dtype=bool)
    psi[:, row, column] = table["psi_d"], table["psi_q"]
    supported[row, column] = table["supported"] > 0
    supported &= np.isfinite(psi).all(axis=0)
    return FluxGrid(i_d, i_q, psi, np.full((2, 2, *shape), np.nan), supported)


def is_map(path: Path) -> bool:
    """Return whether a file is the table of a flux map."""
    try:
        read_grid(path)
    except InputError:
        return False
    return True


def _read_columns(path: Path) -> dict[str, FloatArray]:
    if not path.exists():
        raise InputError(f"{path}: there is no such file; name a flux map, or a result's folder.")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header, *rows = [row for row in csv.reader(file) if row]
        cells = dict(zip(header, zip(*rows, strict=True), strict=True))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(
            f"{path}: cannot be read as a table of a flux map; give a folder that `penode "
            "identify` wrote, or its flux_map.csv."
        ) from error
    missing = [name for name in _COLUMNS if name not in cells]
    if missing:
        raise InputError(
            f"{path}: columns {', '.join(cells)} came without {', '.join(missing)}; name "
            f"those of a map {', '.join(_COLUMNS)}, in A and Vs. A recording has none yet: "
            "identify it, and give the folder."
        )
    cells = {"supported": ("1",) * len(rows), **cells}
    try:
        wanted = {
            name: np.array([float(cell) if cell.strip() else np.nan for cell in cells[name]])
            for name in (*_COLUMNS, "supported")
        }
    except ValueError as error:
        raise InputError(
            f"{path}: a cell is text where a number was wanted ({error}); correct that cell."
        ) from error
    if not np.isfinite([wanted[name] for name in _COLUMNS[:2]]).all():
        raise InputError(f"{path}: a current is missing; give i_d and i_q in every row.")
    return wanted
