"""Discrete current controller: PI with decoupling, a voltage limit and anti-windup."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.pmsm.bench.machines import Machine


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CurrentController:
    """PI controller of the dq currents, one step a sampling interval.

    With e the current error, L and psi_PM what the controller believes::

        u = k_p e + z + omega J (L i + psi_PM),  shortened to at most the voltage limit
        z <- z + T k_i (e + (u - u_wanted) / k_p)
        k_p = 2 bandwidth L,  k_i = bandwidth^2 L

    A machine that is as believed gets both closed-loop poles at -bandwidth. The term in
    u - u_wanted stops the integral z where the limit bites.

    Attributes
    ----------
    inductance : ndarray, shape (2,)
        Believed L_d and L_q in H.
    magnet_flux_linkage : float
        Believed psi_PM in Vs.
    bandwidth : float
        Closed-loop bandwidth in rad/s.
    voltage_limit : float
        Largest length of the voltage vector in V.
    time_step : float
        Sampling interval T in s.
    """

    inductance: FloatArray
    magnet_flux_linkage: float
    bandwidth: float
    voltage_limit: float
    time_step: float

    def step(
        self, integral: JaxArray, reference: JaxArray, current: JaxArray, omega_el: JaxArray
    ) -> tuple[JaxArray, JaxArray]:
        """Return the voltage for the coming interval, and the integral after it.

        Parameters
        ----------
        integral : array, shape (2,)
            Integral part z in V.
        reference, current : array, shape (2,)
            Wanted and measured dq currents at the sampling instant in A.
        omega_el : array, shape ()
            Electrical speed in rad/s.

        Returns
        -------
        voltage, integral : array, shape (2,)
            dq voltage in V to be held, next z in V.
        """
        inductance = jnp.asarray(self.inductance)
        gain = 2.0 * self.bandwidth * inductance
        error = reference - current
        believed = inductance * current + jnp.array([self.magnet_flux_linkage, 0.0])
        induced = omega_el * jnp.stack([-believed[1], believed[0]])
        wanted = gain * error + integral + induced
        length = jnp.hypot(wanted[0], wanted[1])
        voltage = wanted * self.voltage_limit / jnp.maximum(length, self.voltage_limit)
        rise = self.bandwidth**2 * inductance * (error + (voltage - wanted) / gain)
        return voltage, integral + self.time_step * rise


def tuned_controller(
    machine: Machine, *, bandwidth: float, tuning: float, dc_voltage: float, time_step: float
) -> CurrentController:
    """Tune a controller from the data sheet, approximately.

    Parameters
    ----------
    machine : Machine
        Only its data-sheet values are used.
    bandwidth : float
        Closed-loop bandwidth in rad/s that a machine with the believed inductances would get.
    tuning : float
        Believed over data-sheet inductance; 1 is tuned as well as the data sheet allows.
    dc_voltage : float
        Voltage of the dc link in V; the vector is limited to its 1/sqrt(3) (linear modulation).
    time_step : float
        Sampling interval in s.

    Returns
    -------
    CurrentController
    """
    return CurrentController(
        inductance=tuning * np.array([machine.inductance_d, machine.inductance_q]),
        magnet_flux_linkage=machine.magnet_flux_linkage,
        bandwidth=bandwidth,
        voltage_limit=float(dc_voltage / np.sqrt(3.0)),
        time_step=time_step,
    )
