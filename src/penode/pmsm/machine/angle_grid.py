"""A machine's flux map and torque over currents and the angle of the rotor, as a table."""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64
from penode.fit.fit import Fit
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.machine.model import Machine

#: Angles a period of the highest order; nodes of the quadrature along the currents.
_ANGLES, _NODES = 8, 32


@dataclass(frozen=True, eq=False)
class AngleGrid:
    """Flux linkages and torque over the currents of a `FluxGrid` and one electrical turn.

    Attributes
    ----------
    angle : ndarray, shape (angle,)
        Electrical angle of the d axis seen from phase a in degrees, even, from 0 to 360.
    psi : ndarray, shape (2, row, column, angle)
        psi_d and psi_q in Vs.
    torque : ndarray, shape (row, column, angle), or None
        3/2 p (psi_d i_q - psi_q i_d + dW/dtheta) in Nm, W the coenergy; without cogging, the torque
        at no current, which no voltage shows. None without pole pairs.
    """

    angle: FloatArray
    psi: FloatArray
    torque: FloatArray | None


def over_angle(fit: Fit, grid: FluxGrid) -> AngleGrid | None:
    """Tabulate a machine's map over the angle too, at the currents of a grid.

    Parameters
    ----------
    fit : Fit
        Of a machine.
    grid : FluxGrid
        Its currents and pole pairs.

    Returns
    -------
    AngleGrid or None
        None where the map does not depend on the angle.
    """
    orders: tuple[int, ...] = fit.model.flux.angle_orders  # type: ignore[attr-defined]
    if not orders:
        return None
    common = math.gcd(*orders)
    count = _ANGLES * max(orders) // common
    turn = 2 * np.pi / common * np.arange(count) / count
    currents = grid.mesh.reshape(2, -1)
    with float64():
        one_period = [
            [np.asarray(part) for part in _at_angle(fit.model, currents, theta)] for theta in turn
        ]
    every = (np.arange(common * count + 1)) % count
    shape = grid.supported.shape
    psi = np.stack([one_period[k][0].reshape(2, *shape) for k in every], axis=-1)
    slope = np.stack([one_period[k][1].reshape(shape) for k in every], axis=-1)
    torque = None
    if grid.pole_pairs is not None:
        i_d, i_q = grid.mesh[..., None]
        torque = 1.5 * grid.pole_pairs * (psi[0] * i_q - psi[1] * i_d + slope)
    return AngleGrid(np.linspace(0.0, 360.0, common * count + 1), psi, torque)


@jax.jit
def _at_angle(machine: Machine, currents: JaxArray, theta: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Return psi (2, point) in Vs and the slope of the coenergy over the angle (point,) in Ws/rad.

    The slope is the integral of d psi/d theta along the currents, from none to those.
    """
    flux = with_batch_axis(machine).flux
    nodes, weights = (jnp.asarray(one) for one in np.polynomial.legendre.leggauss(_NODES))
    along = (0.5 * (1 + nodes)[:, None] * currents[:, None]).reshape(2, -1)
    rates = flux.at_angle(along, jnp.full(along.shape[1], theta)).angle_slope
    slope = 0.5 * jnp.einsum("n,dnp,dp->p", weights, rates.reshape(2, _NODES, -1), currents)
    return flux.at_angle(currents, jnp.full(currents.shape[1], theta)).linkage, slope
