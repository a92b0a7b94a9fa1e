"""Least squares from a flux map to one coenergy of quintic splines and angle harmonics."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array, vstack

from penode.arrays import FloatArray
from penode.bench.coenergy_table import DERIVE, REACH, SPLINES, CoenergyTable
from penode.bench.flux_table import FluxTable
from penode.errors import InputError

# Cells to one current limit; REACH times this is a whole number, so the middle knot is at 0 A.
_CELLS = 12

# Weight of the third derivatives of the coenergy, per cell, against psi. It decides nothing where
# the map has points and makes L constant where it has none.
_SMOOTHING = 3e-2

# Where third derivatives are taken in a cell, along either axis: Gauss points, so that none hides.
_QUADRATURE = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])

_LEAST_POINTS = 25

_DEFAULT_ORDERS = (6, 12, 18)


@dataclass(frozen=True)
class SplineFit:
    """A fitted coenergy; errors are rms of psi in Vs."""

    table: CoenergyTable
    # Between the map and the fit, over points, angles and axes; it contains the part of the map
    # that is not reciprocal and the harmonics left out.
    fit_error: float
    # Over the angle, in orders that were not fitted.
    left_out: float
    # s in H of the part s J i of the mean map, which no coenergy has; it is left out. The error of
    # a resistance over the electrical speed where the map was measured at one speed.
    skew: float
    # Mean of (L_dd + L_qq)/2 over the map's points, H.
    mean_inductance: float


def fit_splines(
    table: FluxTable, limit: float, orders: tuple[int, ...] | None, mirror: bool
) -> SplineFit:
    """Fit the coenergy whose derivatives are closest to the map, up to 1.25 `limit`, A.

    Orders None are those of 6, 12 and 18 that the angles can resolve; with `mirror` the mirror
    image in i_q belongs to the map.
    """
    orders = _resolved(table, orders)
    reach = REACH * limit
    inside = table.covered & (np.maximum(np.abs(table.i_d), np.abs(table.i_q)) <= reach)
    currents = np.stack([table.i_d[inside], table.i_q[inside]], axis=1)
    flux = np.stack([table.psi_d[inside], table.psi_q[inside]])
    if len(currents) < _LEAST_POINTS:
        raise InputError(
            f"{table.name}: {len(currents)} points of the map lie within {reach:.4g} A, at least "
            f"{_LEAST_POINTS} are wanted; raise the current limit."
        )
    waves = _waves(table.theta_el, orders)
    amplitudes = flux @ np.linalg.pinv(waves).T
    left_out = float(np.sqrt(np.mean((amplitudes @ waves.T - flux) ** 2)))
    if mirror:
        currents, amplitudes = _with_mirror_image(currents, amplitudes, len(orders))
    spacing, cells = limit / _CELLS, round(2 * REACH * _CELLS)
    by_axis = [_rows(currents, spacing, cells, order) for order in ((1, 0), (0, 1))]
    rows = csr_array(vstack(by_axis))
    target = np.concatenate(list(amplitudes))
    turned = np.concatenate([-currents[:, 1], currents[:, 0]])
    solved = _solve(rows, np.column_stack([target, turned]), cells, spacing)
    coefficients, skew = _without_skew(solved, rows, target[:, 0], turned)
    shape = (cells + 5, cells + 5, waves.shape[1])
    fitted = CoenergyTable(coefficients.reshape(shape), spacing, orders)
    wrong = (rows @ coefficients).reshape(amplitudes.shape) - amplitudes
    error = float(np.sqrt(np.mean((wrong @ waves.T) ** 2) + left_out**2))
    curvature = _rows(currents, spacing, cells, (2, 0)) + _rows(currents, spacing, cells, (0, 2))
    inductance = float(np.mean(curvature @ coefficients[:, 0]) / 2)
    return SplineFit(fitted, error, left_out, skew, inductance)


def _without_skew(
    solved: FloatArray, rows: csr_array, mean: FloatArray, turned: FloatArray
) -> tuple[FloatArray, float]:
    """Return the coefficients closest to the map less s J i, and s.

    No coenergy has a flux s J i, and the one closest to it bends sharply at the corners of a map. A
    wrong resistance at the measurement makes just this error.
    """
    coefficients, of_turned = solved[:, :-1], solved[:, -1]
    own = turned - rows @ of_turned
    skew = float(own @ (mean - rows @ coefficients[:, 0]) / (own @ turned))
    coefficients[:, 0] -= skew * of_turned
    return coefficients, skew


def _resolved(table: FluxTable, orders: tuple[int, ...] | None) -> tuple[int, ...]:
    """Return the orders to fit; refuse those that the angles cannot resolve."""
    if orders is None:
        tried = (_DEFAULT_ORDERS[:count] for count in (3, 2, 1))
        return next((some for some in tried if _are_resolved(table.theta_el, some)), ())
    if not all(order > 0 for order in orders) or not _are_resolved(table.theta_el, orders):
        raise InputError(
            f"{table.name}: {len(table.theta_el)} angles cannot resolve the orders "
            f"{', '.join(map(str, orders))}; give more angles or fewer orders."
        )
    return tuple(orders)


def _are_resolved(theta: FloatArray, orders: tuple[int, ...]) -> bool:
    """Return whether these angles resolve the mean and all harmonics."""
    values = np.linalg.svd(_waves(theta, orders), compute_uv=False)
    return len(theta) >= 1 + 2 * len(orders) and bool(values[-1] > 0.1 * values[0])


def _waves(theta: FloatArray, orders: tuple[int, ...]) -> FloatArray:
    """Return 1, the cosines and the sines of the orders, (angle, 1 + 2 order)."""
    phase = theta[:, None] * np.array(orders, dtype=float)
    return np.concatenate([np.ones((len(theta), 1)), np.cos(phase), np.sin(phase)], axis=1)


def _with_mirror_image(
    currents: FloatArray, amplitudes: FloatArray, orders: int
) -> tuple[FloatArray, FloatArray]:
    """Append psi(i_d, -i_q, -theta): psi_q and the sine terms change their sign."""
    signs = np.concatenate([np.ones(1 + orders), -np.ones(orders)])
    image = amplitudes * signs * np.array([1.0, -1.0])[:, None, None]
    both = np.concatenate([amplitudes, image], axis=1)
    return np.concatenate([currents, currents * [1.0, -1.0]]), both


def _rows(
    currents: FloatArray, spacing: float, cells: int, derivatives: tuple[int, int]
) -> csr_array:
    """Return the sparse matrix from coefficients to a derivative of W, (point, coefficient)."""
    position = currents / spacing + cells / 2
    along_d, numbers_d = _cell_splines(position[:, 0], cells, derivatives[0])
    along_q, numbers_q = _cell_splines(position[:, 1], cells, derivatives[1])
    values = along_d[:, :, None] * along_q[:, None, :] / spacing ** sum(derivatives)
    numbers = numbers_d[:, :, None] * (cells + 5) + numbers_q[:, None, :]
    starts = 36 * np.arange(len(currents) + 1)
    shape = (len(currents), (cells + 5) ** 2)
    return csr_array((values.ravel(), numbers.ravel(), starts), shape=shape)


def _cell_splines(
    position: FloatArray, cells: int, derivative: int
) -> tuple[FloatArray, FloatArray]:
    """Return values and numbers (point, 6) of the splines that are not zero at `position` (point,).

    Positions are in spacings, 0 to `cells`; of the ``cells + 5`` splines the values are
    derivatives by the position.
    """
    cell = np.clip(np.floor(position), 0, cells - 1)
    powers = np.power((position - cell)[:, None], np.arange(6))
    polynomials = np.linalg.matrix_power(DERIVE, derivative) @ SPLINES
    return powers @ polynomials, cell[:, None].astype(int) + np.arange(6)


def _solve(rows: csr_array, flux: FloatArray, cells: int, spacing: float) -> FloatArray:
    """Return the coefficients (coefficient, wave) of the smoothest coenergy closest to psi.

    The coenergy without current, not determined by psi, is 0 in every wave: there is no cogging.
    """
    count = rows.shape[0]
    matrix = (rows.T @ rows).toarray() / count + _smoothness(cells) / spacing**2
    solved: FloatArray = cho_solve(cho_factor(matrix), rows.T @ flux / count)
    return solved


@lru_cache(maxsize=1)
def _smoothness(cells: int) -> FloatArray:
    """Return the matrix of the mean square of the third derivatives, a cell long, times the weight.

    It contains the square of the coenergy without current as well.
    """
    nodes = (np.arange(cells)[:, None] + _QUADRATURE).ravel() - cells / 2
    points = np.array(list(product(nodes, repeat=2)))
    rest = _rows(np.zeros((1, 2)), 1.0, cells, (0, 0))
    matrix: FloatArray = (rest.T @ rest).toarray()
    for derivatives, times in (((3, 0), 1), ((2, 1), 3), ((1, 2), 3), ((0, 3), 1)):
        third = _rows(points, 1.0, cells, derivatives)
        matrix += times * _SMOOTHING**2 / len(points) * (third.T @ third).toarray()
    matrix.flags.writeable = False
    return matrix
