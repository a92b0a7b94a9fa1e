"""Discrete current controller: PI with decoupling, a voltage limit and anti-windup."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.bench.machines import Machine
from penode.bench.phases import quarter_turned
from penode.bench.sensors import Reading
from penode.bench.voltage_limits import Circle, VoltageLimit

_CIRCLE = Circle()


class CurrentController(eqx.Module):
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
    limit : VoltageLimit
        The voltages it keeps to.
    dc_voltage : float
        Voltage of the dc link in V.
    time_step : float
        Sampling interval T in s.
    """

    inductance: FloatArray
    magnet_flux_linkage: float
    bandwidth: float
    limit: VoltageLimit
    dc_voltage: float
    time_step: float

    def step(
        self, integral: JaxArray, reference: JaxArray, reading: Reading, angle: JaxArray
    ) -> tuple[JaxArray, JaxArray]:
        """Return the voltage for an interval, and the integral after it.

        Parameters
        ----------
        integral : array, shape (2,)
            Integral part z in V.
        reference : array, shape (2,)
            Wanted dq currents at the sampling instant in A.
        reading : Reading
            Measured currents in A and electrical speed in rad/s.
        angle : array, shape ()
            Electrical angle in rad at which the voltage is to be sent to the phases.

        Returns
        -------
        voltage, integral : array, shape (2,)
            dq voltage in V to be held, next z in V.
        """
        inductance = jnp.asarray(self.inductance)
        gain = 2.0 * self.bandwidth * inductance
        error = reference - reading.current
        induced = self.induced(reading.current, reading.omega_el)
        wanted = gain * error + integral + induced
        voltage = wanted / jnp.maximum(self.limit.used(wanted, angle, self.dc_voltage), 1.0)
        rise = self.bandwidth**2 * inductance * (error + (voltage - wanted) / gain)
        return voltage, integral + self.time_step * rise

    def induced(self, current: JaxArray, omega_el: JaxArray) -> JaxArray:
        """Return the voltage that the controller believes rotation induces.

        Parameters
        ----------
        current : array, shape (2,)
            i_d and i_q in A.
        omega_el : array, shape ()
            Electrical speed in rad/s.

        Returns
        -------
        array, shape (2,)
            ``omega J (L i + psi_PM)`` in V.
        """
        magnet = jnp.stack([self.magnet_flux_linkage, 0.0])
        return omega_el * quarter_turned(jnp.asarray(self.inductance) * current + magnet)


def tuned_controller(
    machine: Machine,
    *,
    bandwidth: float,
    tuning: float,
    dc_voltage: float,
    time_step: float,
    limit: VoltageLimit = _CIRCLE,
) -> CurrentController:
    """Tune a controller from the data sheet to a bandwidth in rad/s, approximately.

    `tuning` is the believed inductance over that of the data sheet; a machine with the believed
    one would get the bandwidth.
    """
    return CurrentController(
        inductance=tuning * np.array([machine.inductance_d, machine.inductance_q]),
        magnet_flux_linkage=machine.magnet_flux_linkage,
        bandwidth=bandwidth,
        limit=limit,
        dc_voltage=dc_voltage,
        time_step=time_step,
    )
