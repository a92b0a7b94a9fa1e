"""A machine's coenergy as a fine table, four times continuously differentiable.

The table holds the coenergy and nothing else: quintic splines over (i_d, i_q) and, over the angle,
the harmonics the machine has. Flux linkage, differential inductance and their slope over the angle
are the derivatives of that one interpolant, so psi and L agree exactly and L is symmetric between
the nodes too. A table of psi beside a table of L would satisfy neither. The fifth degree makes L
smooth enough where cells meet for a Runge-Kutta method to keep its order; cubic splines do not.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64
from penode.bench.machines import Machine
from penode.errors import InputError

#: Half width of a machine's table over its current limit.
REACH = 1.25

#: Cells of the table to one current limit.
_CELLS = 60

#: Quintic B-splines on evenly spaced knots: column j is the polynomial of the j-th of the six that
#: are not zero in a cell, row n its coefficient of the n-th power of the position 0..1 in the cell.
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

_SPLINE_DERIVATIVES = np.stack([SPLINES, DERIVE @ SPLINES, DERIVE @ DERIVE @ SPLINES])


class Flux(NamedTuple):
    """psi (2,), Vs, d psi/di (2, 2), H (row psi), and d psi/d theta (2,), Vs/rad, at one point."""

    linkage: JaxArray
    inductance: JaxArray
    angle_slope: JaxArray


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CoenergyTable:
    """Coenergy over (i_d, i_q, theta_el), interpolated by quintic splines and a Fourier series."""

    # Of the mean coenergy, its cosine and its sine terms, J: (node_d + 4, node_q + 4, 1 + 2 order).
    coefficients: FloatArray
    # Distance of the nodes, A; the middle node is at no current.
    spacing: float
    # Harmonics of the electrical angle.
    orders: tuple[int, ...] = field(metadata={"static": True})

    @property
    def reach(self) -> float:
        """Largest |i_d| and |i_q| of the table in A."""
        cells: int = self.coefficients.shape[0] - 5
        return self.spacing * cells / 2

    @property
    def mean(self) -> "CoenergyTable":
        """The mean over the angle."""
        return CoenergyTable(self.coefficients[..., :1], self.spacing, ())

    def __call__(self, current: JaxArray, theta_el: JaxArray) -> Flux:
        """Return the flux at currents (2,), A, and an angle, rad.

        Outside the table the outermost cells are continued.
        """
        w = self._derivatives(current, theta_el)
        return Flux(
            linkage=jnp.stack([w[1, 0, 0], w[0, 1, 0]]),
            inductance=jnp.stack([w[2, 0, 0], w[1, 1, 0], w[1, 1, 0], w[0, 2, 0]]).reshape(2, 2),
            angle_slope=jnp.stack([w[1, 0, 1], w[0, 1, 1]]),
        )

    def coenergy(self, current: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return the coenergy W of the dq frame, J; that of the three phases is 3/2 W.

        The energy stored in the field is ``3/2 (psi_d i_d + psi_q i_q - W)``.
        """
        return self._derivatives(current, theta_el)[0, 0, 0]

    def coenergy_angle_slope(self, current: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return dW/dtheta_el at constant dq currents, J/rad: the harmonics' part of the torque.

        ``torque = 3/2 p (psi_d i_q - psi_q i_d + dW/dtheta_el)``: like the cross product it takes
        the factor 3/2 of the amplitude-invariant transform and the pole pairs p.
        """
        return self._derivatives(current, theta_el)[0, 0, 1]

    def _derivatives(self, current: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return w (3, 3, 2): w[m, n, 0] is W derived m times by i_d and n by i_q, 1 its slope."""
        cells = self.coefficients.shape[0] - 5
        position = current / self.spacing + cells / 2
        cell = jnp.clip(jnp.floor(position), 0, cells - 1)
        along_d, along_q = _spline_derivatives(position - cell, self.spacing)
        corner = cell.astype(int)
        block = jax.lax.dynamic_slice(
            jnp.asarray(self.coefficients),
            (corner[0], corner[1], jnp.zeros_like(corner[0])),
            (6, 6, self.coefficients.shape[2]),
        )
        # Sums of products, not einsum: XLA fuses them, which makes the simulation twice as fast.
        patch = (block[..., None] * _waves(theta_el, self.orders)).sum(2)
        patch = (along_q[:, None, :, None] * patch).sum(2)
        w: JaxArray = (along_d[:, None, :, None] * patch).sum(2)
        return w


@dataclass(frozen=True, eq=False)
class SplineCoenergy:
    """A table, to 1.25 times the current limit, as the coenergy of a machine from a map."""

    table: CoenergyTable

    def __call__(self, i_d: JaxArray, i_q: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return the coenergy, J, of the shape to which the arguments (A, rad) broadcast."""
        i_d, i_q, theta_el = jnp.broadcast_arrays(i_d, i_q, theta_el)
        look_up = jnp.vectorize(self.table.coenergy, signature="(n),()->()")
        coenergy: JaxArray = look_up(jnp.stack([i_d, i_q], axis=-1), theta_el)
        return coenergy


@lru_cache(maxsize=8)
def tabulate(machine: Machine) -> CoenergyTable:
    """Sample a machine's coenergy to a table, which is kept, for a machine is immutable.

    It has nodes every 1/60 of the current limit, to 1.25 times the limit in either axis. For the
    built-in machines psi is within 2e-9 Vs and L within 4e-9 H of the coenergy's derivatives
    (1e-10 for `TRACTION_300A`). A machine imported from a map is its own table.
    """
    if isinstance(machine.coenergy, SplineCoenergy):
        return machine.coenergy.table
    spacing = machine.current_limit / _CELLS
    half = round(REACH * _CELLS)
    nodes = spacing * np.arange(-half, half + 1)
    highest = max(machine.angle_orders, default=0)
    angles = 2 * np.pi * np.arange(2 * highest + 1) / (2 * highest + 1)
    with float64():
        grid = (nodes[:, None, None], nodes[:, None], angles)
        samples = np.asarray(jax.jit(machine.coenergy)(*map(jnp.asarray, grid)))
        waves = np.asarray(jax.vmap(_waves, (0, None))(jnp.asarray(angles), machine.angle_orders))[
            ..., 0
        ]
    by_angle = samples @ np.linalg.pinv(waves).T
    to_coefficients = _spline_coefficients(len(nodes))
    along_d = np.tensordot(to_coefficients, by_angle, axes=(1, 0))
    along_q = np.tensordot(to_coefficients, along_d, axes=(1, 1))
    return CoenergyTable(np.swapaxes(along_q, 0, 1), spacing, machine.angle_orders)


def true_flux_map(machine: Machine, i_d: FloatArray, i_q: FloatArray) -> FloatArray:
    """Return the flux linkage a map without angle should find: the mean over the angle.

    Parameters
    ----------
    machine : Machine
        The machine.
    i_d, i_q : ndarray, any shapes that broadcast
        Currents in A, at most 1.25 times the current limit each.

    Returns
    -------
    ndarray, the broadcast shape + (2,)
        psi_d and psi_q in Vs.
    """
    table = tabulate(machine)
    currents = np.stack(np.broadcast_arrays(i_d, i_q), axis=-1).astype(np.float64)
    if not np.all(np.abs(currents) <= table.reach):
        raise InputError(
            f"{machine.name}: currents must be at most the {table.reach:.4g} A of its table, got "
            f"{np.abs(currents).max():.4g} A."
        )
    with float64():
        linkage = _mean_linkage(table, jnp.asarray(currents.reshape(-1, 2)))
        return np.asarray(linkage).reshape(currents.shape)


@jax.jit
def _mean_linkage(table: CoenergyTable, currents: JaxArray) -> JaxArray:
    """Return the mean of psi over the angle, (batch, 2): the order 0 of the table alone."""
    return jax.vmap(table.mean, (0, None))(currents, jnp.zeros(())).linkage


def _waves(theta_el: JaxArray, orders: tuple[int, ...]) -> JaxArray:
    """Return 1, the cosines and the sines of the orders beside their slopes, (1 + 2 order, 2)."""
    n = jnp.array(orders, dtype=float)
    cosine, sine = jnp.cos(n * theta_el), jnp.sin(n * theta_el)
    values = jnp.concatenate([jnp.ones(1), cosine, sine])
    slopes = jnp.concatenate([jnp.zeros(1), -n * sine, n * cosine])
    return jnp.stack([values, slopes], axis=1)


def _spline_derivatives(position: JaxArray, spacing: float) -> JaxArray:
    """Return the six splines of a cell: (axis, derivative 0..2, spline), per A^derivative."""
    powers = jnp.stack([position**n for n in range(6)], axis=-1)
    scale = jnp.stack([jnp.ones(()), 1 / spacing, 1 / spacing**2])
    return (powers[:, None, :, None] * _SPLINE_DERIVATIVES).sum(2) * scale[:, None]


def _spline_coefficients(nodes: int) -> FloatArray:
    """Return the matrix from node values to spline coefficients, (nodes + 4, nodes).

    Coefficients j to j + 4 meet at node j; the four conditions left over are that the fifth
    derivative passes the two nodes next to each end without a jump.
    """
    conditions = np.zeros((nodes + 4, nodes + 4))
    for shift, weight in enumerate(SPLINES[0, :5]):
        conditions[np.arange(nodes), np.arange(nodes) + shift] = weight
    jump = (1, -6, 15, -20, 15, -6, 1)
    for row, first in enumerate((0, 1, nodes - 4, nodes - 3), start=nodes):
        conditions[row, first : first + 7] = jump
    return np.asarray(np.linalg.inv(conditions)[:, :nodes], dtype=np.float64)
