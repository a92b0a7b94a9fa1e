"""The voltage equation of a permanent-magnet synchronous machine as a state-space model."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf, float64
from penode.models.base import Model
from penode.models.parameters import physical, with_batch_axis
from penode.pmsm.flux_maps import FluxMap


class Machine(Model):
    """di/dt = L(i)^-1 (u - R i - omega J psi(i)), the paper's current ODE.

    Attributes
    ----------
    flux : FluxMap
        psi(i) in Vs and L(i) = d psi / d i in H.
    R : array, shape ()
        Stator resistance in ohm.
    """

    states: ClassVar[tuple[str, ...]] = ("i_d", "i_q")
    inputs: ClassVar[tuple[str, ...]] = ("u_d", "u_q", "omega_el")
    state_units: ClassVar[tuple[str, ...]] = ("A", "A")

    flux: FluxMap
    R: Leaf = physical("ohm")

    def derivative(self, x: JaxArray, u: JaxArray) -> JaxArray:
        """Return di/dt (2, batch) in A/s from i (2, batch) in A and u_d, u_q (V), omega (rad/s)."""
        (psi_d, psi_q), ((l_dd, l_dq), (l_qd, l_qq)) = self.flux.flux_and_inductance(x)
        v_d = u[0] - self.R * x[0] + u[2] * psi_q
        v_q = u[1] - self.R * x[1] - u[2] * psi_d
        determinant = l_dd * l_qq - l_dq * l_qd
        rates: tuple[JaxArray, JaxArray] = (l_qq * v_d - l_dq * v_q, l_dd * v_q - l_qd * v_d)
        slope: JaxArray = jnp.stack(rates) / determinant
        return slope

    def learned(self, x: JaxArray) -> JaxArray:
        """Return psi (2, batch) in Vs at currents x (2, batch) in A."""
        return self.flux.flux_and_inductance(x)[0]

    def maps(self) -> Mapping[str, Callable[..., Any]]:
        """Return ``flux_map`` and ``differential_inductance`` as functions of i_d, i_q in A."""
        return {
            "flux_map": lambda i_d, i_q: _evaluate(self, i_d, i_q)[0],
            "differential_inductance": lambda i_d, i_q: _evaluate(self, i_d, i_q)[1],
        }


def _evaluate(machine: Machine, i_d: Any, i_q: Any) -> tuple[FloatArray, FloatArray]:
    """Return psi (2, *shape) in Vs and L (2, 2, *shape) in H for currents of any one shape."""
    currents = np.stack(np.broadcast_arrays(np.asarray(i_d, float), np.asarray(i_q, float)))
    shape = currents.shape[1:]
    with float64():
        flat = jnp.asarray(currents.reshape(2, -1))
        psi, inductance = with_batch_axis(machine).flux.flux_and_inductance(flat)
        return np.asarray(psi).reshape(2, *shape), np.asarray(inductance).reshape(2, 2, *shape)
