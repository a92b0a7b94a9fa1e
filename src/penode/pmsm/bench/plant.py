"""The simulated plant: a machine's current dynamics, integrated between two samples.

This is the truth of the bench. It shares no code with the models that are to find it.
"""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.pmsm.bench.coenergy_table import CoenergyTable, tabulate
from penode.pmsm.bench.machines import Machine

# The most that the fastest harmonic may turn in one integration step, in rad.
_LARGEST_TURN = 0.2


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Plant:
    """The winding's differential equation, ``u = R i + omega J psi + d psi/dt``, in the currents.

    ``di/dt = L^-1 (u - R i - omega J psi - omega d psi/d theta)`` at constant speed.

    Attributes
    ----------
    table : CoenergyTable
        The machine.
    resistance : float
        R in ohm.
    time_step : float
        Interval in s over which the voltage is held in the rotor frame.
    substeps : int
        Integration steps to one interval.
    """

    table: CoenergyTable
    resistance: float
    time_step: float
    substeps: int = field(metadata={"static": True})

    def derivative(
        self, current: JaxArray, voltage: JaxArray, theta_el: JaxArray, omega_el: JaxArray
    ) -> JaxArray:
        """Return di/dt.

        Parameters
        ----------
        current : array, shape (2,)
            i_d and i_q in A.
        voltage : array, shape (2,)
            u_d and u_q in V.
        theta_el : array, shape ()
            Electrical angle in rad.
        omega_el : array, shape ()
            Electrical speed in rad/s.

        Returns
        -------
        array, shape (2,)
            di/dt in A/s.
        """
        psi, inductance, slope = self.table(current, theta_el)
        rotation = jnp.stack([-psi[1], psi[0]])
        left = voltage - self.resistance * current - omega_el * (rotation + slope)
        l_dd, l_dq, l_qq = inductance[0, 0], inductance[0, 1], inductance[1, 1]
        solved = jnp.stack([l_qq * left[0] - l_dq * left[1], l_dd * left[1] - l_dq * left[0]])
        rate: JaxArray = solved / (l_dd * l_qq - l_dq**2)
        return rate

    def advance(
        self, current: JaxArray, voltage: JaxArray, theta_el: JaxArray, omega_el: JaxArray
    ) -> JaxArray:
        """Return the current one interval later, by classic Runge-Kutta steps.

        Parameters
        ----------
        current : array, shape (2,)
            i_d and i_q at the start in A.
        voltage : array, shape (2,)
            u_d and u_q in V, constant in the rotor frame.
        theta_el : array, shape ()
            Electrical angle at the start in rad.
        omega_el : array, shape ()
            Electrical speed in rad/s, constant.

        Returns
        -------
        array, shape (2,)
            i_d and i_q at the end in A.
        """
        h = self.time_step / self.substeps

        def slope(current: JaxArray, time: JaxArray) -> JaxArray:
            return self.derivative(current, voltage, theta_el + omega_el * time, omega_el)

        def substep(index: JaxArray, current: JaxArray) -> JaxArray:
            start = index * h
            k1 = slope(current, start)
            k2 = slope(current + h / 2 * k1, start + h / 2)
            k3 = slope(current + h / 2 * k2, start + h / 2)
            k4 = slope(current + h * k3, start + h)
            return current + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

        end: JaxArray = jax.lax.fori_loop(0, self.substeps, substep, current)
        return end


def plant_of(machine: Machine, *, time_step: float, omega_el: float) -> Plant:
    """Return the plant of a machine, integrated finely enough for a speed.

    Parameters
    ----------
    machine : Machine
        The machine.
    time_step : float
        Interval in s over which the voltage is held.
    omega_el : float
        Highest electrical speed in rad/s. The fastest harmonic turns by at most 0.2 rad in one
        integration step, of which there are at least two; voltage steps of 25 V then leave an error
        below 1e-8 of the built-in machine's current limit.

    Returns
    -------
    Plant
    """
    turn = max(machine.angle_orders, default=1) * abs(omega_el) * time_step
    substeps = max(2, int(np.ceil(turn / _LARGEST_TURN)))
    return Plant(tabulate(machine), machine.resistance, time_step, substeps)
