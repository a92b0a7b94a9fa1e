"""Discrete current controller: PI with decoupling, a voltage limit and anti-windup."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.bench.drive import Drive
from penode.bench.inverter import VoltageLimit
from penode.bench.machines import Machine
from penode.bench.phases import quarter_turned
from penode.bench.sensors import Reading


class CurrentController(eqx.Module):
    """PI controller of the dq currents, one step a sampling interval.

    With e the current error, L and psi_PM what the controller believes::

        u = k_p e + z + omega J (L i + psi_PM),  shortened to at most the voltage limit
        z <- z + T k_i (e + (u - u_wanted) / k_p)
        k_p = 2 bandwidth L,  k_i = bandwidth^2 L

    A machine that is as believed gets both closed-loop poles at -bandwidth. The term in
    u - u_wanted stops the integral z where the limit bites.
    """

    # Believed L_d and L_q (2,), H.
    inductance: FloatArray
    # Believed psi_PM, Vs.
    magnet_flux_linkage: float
    # Of the closed loop, rad/s.
    bandwidth: float
    limit: VoltageLimit
    # Of the dc link, V.
    dc_voltage: float
    # Sampling interval T, s.
    time_step: float

    @classmethod
    def tuned(cls, machine: Machine, drive: Drive) -> "CurrentController":
        """Return a drive's controller, tuned from the machine's data sheet.

        A machine whose inductance were the believed one would get the drive's bandwidth.
        """
        return cls(
            inductance=drive.tuning * np.array([machine.inductance_d, machine.inductance_q]),
            magnet_flux_linkage=machine.magnet_flux_linkage,
            bandwidth=drive.bandwidth,
            limit=drive.inverter.limit,
            dc_voltage=drive.dc_voltage,
            time_step=drive.time_step,
        )

    def step(
        self, integral: JaxArray, reference: JaxArray, reading: Reading, angle: JaxArray
    ) -> tuple[JaxArray, JaxArray]:
        """Return the dq voltage (2,), V, to be held, and the integral z (2,), V, after it.

        The wanted currents are in A; at `angle`, rad, the voltage is sent to the phases.
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
        """Return what rotation is believed to induce, ``omega J (L i + psi_PM)`` (2,), V."""
        magnet = jnp.stack([self.magnet_flux_linkage, 0.0])
        return omega_el * quarter_turned(jnp.asarray(self.inductance) * current + magnet)
