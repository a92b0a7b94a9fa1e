"""Quintic B-splines on evenly spaced knots, one spacing long."""

import numpy as np

from penode.arrays import FloatArray

#: Column j is the polynomial of the j-th of the six splines that are not zero in a cell, row n its
#: coefficient of the n-th power of the position 0..1 within the cell.
SPLINES: FloatArray = (
    np.array(
        [
            [1, 26, 66, 26, 1, 0],
            [-5, -50, 0, 50, 5, 0],
            [10, 20, -60, 20, 10, 0],
            [-10, 20, 0, -20, 10, 0],
            [5, -20, 30, -20, 5, 0],
            [-1, 5, -10, 10, -5, 1],
        ]
    )
    / 120.0
)

#: ``DERIVE @ polynomials`` are their derivatives by the position within the cell.
DERIVE: FloatArray = np.diag(np.arange(1.0, 6.0), k=1)


def cell_splines(
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
