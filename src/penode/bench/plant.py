"""The simulated plant: everything on the bench that moves between two samples.

Winding, iron, shaft and the sensors' filter are one differential equation, integrated by classic
Runge-Kutta steps through the inverter's pulses. This is the truth of the bench. It shares no code
with the models that are to find it.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.bench.coenergy_table import CoenergyTable, Flux
from penode.bench.inverter import Pulses
from penode.bench.phases import quarter_turned
from penode.bench.sensors import CurrentSensors, Terminals
from penode.bench.shaft import Motion, Shaft
from penode.bench.winding import IronLoss, Winding


class State(NamedTuple):
    """The plant at one moment. The slopes of these quantities are a `State` too."""

    # (2,), A, that make the flux; the terminals carry the iron's current beside it.
    current: JaxArray
    theta_el: JaxArray
    omega_el: JaxArray
    # Of the winding, degC.
    temperature: JaxArray
    # Terminal current behind the sensors' filter, in the rotor frame (2,), A.
    filtered: JaxArray | None = None


#: Takes terminal current (2,) in A and angle () in rad, returns the terminal voltage (2,) in V.
VoltageAt = Callable[[JaxArray, JaxArray], JaxArray]


class Copper(eqx.Module):
    """Resistance of a phase, ``R (1 + alpha (T - T_ref))``, in ohm, 1/K and degC."""

    resistance: float
    coefficient: float
    reference: float

    def at(self, temperature: JaxArray) -> JaxArray:
        """Return the resistance in ohm at a temperature in degrees Celsius."""
        return self.resistance * (1.0 + self.coefficient * (temperature - self.reference))


class Plant(eqx.Module):
    """The machine's differential equation, ``u = R i + omega J psi + d psi/dt``, in the currents.

    ``di/dt = L^-1 (u - R i - omega J psi - omega d psi/d theta)``, beside the equations of the
    shaft, of the winding's temperature and of the sensors' filter.
    """

    table: CoenergyTable
    copper: Copper
    # What the magnets' temperature adds to psi_d, Vs.
    magnet_flux_change: float
    winding: Winding
    iron_loss: IronLoss | None
    shaft: Shaft
    # None where they have no filter to be integrated.
    sensors: CurrentSensors | None
    # Integration steps to one pulse of the inverter.
    substeps: int = eqx.field(static=True)

    def rest(self, theta_el: JaxArray, omega_el: JaxArray) -> State:
        """Return the state without current at an electrical angle (rad) and speed (rad/s)."""
        none = jnp.zeros(2)
        start = self.winding.temperature
        temperature = jnp.asarray(self.copper.reference if start is None else start, none.dtype)
        filtered = None if self.sensors is None else none
        return State(none, theta_el, omega_el, temperature, filtered)

    def at_sample(self, state: State, given: Motion) -> State:
        """Return the state at a sampling instant, where a given motion of the shaft takes over."""
        theta_el, omega_el = self.shaft.at_sample((state.theta_el, state.omega_el), given)
        return state._replace(theta_el=theta_el, omega_el=omega_el)

    def terminals(self, state: State) -> Terminals:
        """Return what there is to be measured, the iron's current included."""
        current = state.current
        if self.iron_loss is not None:
            current = self._terminal_current(state, self._flux(state).linkage)
        return Terminals(current, state.filtered, state.theta_el, state.omega_el)

    def slope(self, state: State, voltage_at: VoltageAt, acceleration: JaxArray) -> State:
        """Return the slopes of the state per second.

        `voltage_at` gives terminal voltage (2,), V, of terminal current (2,), A, and angle,
        rad; `acceleration` (rad/s^2, electrical) is that of a shaft whose speed is given.
        """
        flux = self._flux(state)
        current = self._terminal_current(state, flux.linkage)
        voltage = voltage_at(current, state.theta_el)
        drop = self.copper.at(state.temperature) * self.winding.relative_drop(
            current, state.theta_el
        )
        left = voltage - drop - state.omega_el * (quarter_turned(flux.linkage) + flux.angle_slope)
        return State(
            current=_solved(flux.inductance, left),
            theta_el=state.omega_el,
            omega_el=self.shaft.slope(
                lambda: self._torque(state, flux), state.omega_el, acceleration
            ),
            temperature=self.winding.warming_rate(state.temperature, 1.5 * (drop * current).sum()),
            filtered=self._filter_slope(state, current),
        )

    def advance(
        self,
        state: State,
        pulses: Pulses,
        voltages: Callable[[JaxArray], VoltageAt],
        acceleration: JaxArray,
    ) -> State:
        """Return the state after the inverter's pulses, by classic Runge-Kutta steps.

        `voltages` makes the ``voltage_at`` of `slope` from a pulse's voltage (2,), V.
        """

        def pulse(state: State, one: Pulses) -> tuple[State, None]:
            voltage_at = voltages(one.vectors)

            def rates(state: State) -> State:
                return self.slope(state, voltage_at, acceleration)

            step = one.durations / self.substeps
            end = jax.lax.fori_loop(
                0, self.substeps, lambda _, state: _runge_kutta(rates, state, step), state
            )
            return end, None

        end, _ = jax.lax.scan(pulse, state, pulses)
        return end

    def _terminal_current(self, state: State, linkage: JaxArray) -> JaxArray:
        if self.iron_loss is None:
            return state.current
        return state.current + self.iron_loss.current(state.omega_el * quarter_turned(linkage))

    def torque(self, state: State) -> JaxArray:
        """Return ``3/2 (psi_d i_q - psi_q i_d + dW/dtheta)``, the torque of one pole pair in Nm."""
        return self._torque(state, self._flux(state))

    def _torque(self, state: State, flux: Flux) -> JaxArray:
        current, psi = state.current, flux.linkage
        slope = self.table.coenergy_angle_slope(current, state.theta_el)
        return 1.5 * (psi[0] * current[1] - psi[1] * current[0] + slope)

    def _flux(self, state: State) -> Flux:
        flux = self.table(state.current, state.theta_el)
        change = jnp.stack([self.magnet_flux_change, 0.0])
        return flux._replace(linkage=flux.linkage + change)

    def _filter_slope(self, state: State, current: JaxArray) -> JaxArray | None:
        if self.sensors is None or state.filtered is None:
            return None
        return self.sensors.filter_rate(state.filtered, current, state.omega_el)


def _solved(inductance: JaxArray, voltage: JaxArray) -> JaxArray:
    """Return L^-1 u, (2,), of a symmetric L."""
    l_dd, l_dq, l_qq = inductance[0, 0], inductance[0, 1], inductance[1, 1]
    by_d = l_qq * voltage[0] - l_dq * voltage[1]
    by_q = l_dd * voltage[1] - l_dq * voltage[0]
    return jnp.stack([by_d, by_q]) / (l_dd * l_qq - l_dq**2)


def _runge_kutta(rates: Callable[[State], State], state: State, step: JaxArray) -> State:
    """Return the state one classic Runge-Kutta step later."""

    def moved(share: float, slope: State) -> State:
        end: State = jax.tree.map(lambda x, v: x + share * step * v, state, slope)
        return end

    k1 = rates(state)
    k2 = rates(moved(0.5, k1))
    k3 = rates(moved(0.5, k2))
    k4 = rates(moved(1.0, k3))
    mean = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4)
    return moved(1.0, mean)
