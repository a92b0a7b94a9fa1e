"""The voltages an inverter can make: how a controller's voltage is shortened to them."""

from typing import Protocol

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.bench.phases import phases, rotated


class VoltageLimit(Protocol):
    """The set of voltages that a dc link permits."""

    def used(self, voltage: JaxArray, theta_el: JaxArray, dc_voltage: JaxArray | float) -> JaxArray:
        """Return the length of a dq voltage (2,) in V over the longest permitted in its direction.

        ``theta_el`` is the angle (rad) at which it is sent to the phases, ``dc_voltage`` in V.
        """


class Circle(eqx.Module):
    """The voltages reachable at every angle: length at most ``u_dc / sqrt(3)``."""

    def used(self, voltage: JaxArray, theta_el: JaxArray, dc_voltage: JaxArray | float) -> JaxArray:
        """Return the length of a dq voltage (2,) over ``u_dc / sqrt(3)``, permitted up to 1."""
        share: JaxArray = jnp.hypot(voltage[0], voltage[1]) / (dc_voltage / np.sqrt(3.0))
        return share


class Hexagon(eqx.Module):
    """All voltages an inverter can make: no line-to-line voltage above u_dc."""

    def used(self, voltage: JaxArray, theta_el: JaxArray, dc_voltage: JaxArray | float) -> JaxArray:
        """Return the largest line-to-line voltage over u_dc, permitted up to 1.

        The dq voltage (2,) is sent to the phases at `theta_el`, rad.
        """
        by_phase = phases(rotated(voltage, theta_el))
        return (by_phase.max() - by_phase.min()) / dc_voltage
