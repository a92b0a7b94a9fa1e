"""The voltage equation of a permanent-magnet synchronous machine as a state-space model."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, in_blocks
from penode.models.base import Model
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.flux_maps import Flux, FluxMap
from penode.pmsm.machine.frames import solved
from penode.pmsm.machine.term_registry import channels_of, completed
from penode.pmsm.machine.terms import ANGLE, SPEED, Channel, Term


class Machine(Model):
    """di/dt = L(i)^-1 (u - sum of drops), the paper's current ODE.

    The drops are R i and omega (J psi + d psi / d theta), and those of the terms given beside or in
    place of them (`penode.pmsm.machine.terms`).

    Attributes
    ----------
    flux : FluxMap
        psi(i) in Vs and L(i) = d psi / d i in H, at the rotor's angle where it has harmonics.
    terms : tuple of Term
        What takes up voltage; completed by resistance and rotation where they are not given.
    """

    states: ClassVar[tuple[str, ...]] = ("i_d", "i_q")
    state_units: ClassVar[tuple[str, ...]] = ("A", "A")
    input_rates: ClassVar[Mapping[str, str]] = {ANGLE.name: ANGLE.rate}
    map_units: ClassVar[Mapping[str, str]] = {"flux_map": "Vs", "differential_inductance": "H"}

    flux: FluxMap
    terms: tuple[Term, ...] = eqx.field(default=(), converter=completed)

    @property
    def channels(self) -> dict[str, Channel]:
        """Channels that the terms and the map need beside voltages and currents, by name."""
        channels = {SPEED.name: SPEED}
        if self.flux.angle_orders:
            channels[ANGLE.name] = ANGLE
        return {**channels, **channels_of(self.terms)}

    @property
    def inputs(self) -> tuple[str, ...]:
        """u_d and u_q (V), and the channels that the terms and the map need."""
        return ("u_d", "u_q", *self.channels)

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return di/dt (2, batch) in A/s.

        Parameters
        ----------
        x : array, shape (2, batch)
            i_d and i_q in A.
        u : Inputs, rows of shape (batch,)
            u_d and u_q (V), omega_el (rad/s), and what the terms need.
        """
        flux = _flux(self.flux, x, u[ANGLE.name] if self.flux.angle_orders else None)
        left = u["u_d", "u_q"]
        for term in self.terms:
            left = left - term.drop(x, u, flux)
        rates: JaxArray = solved(flux.inductance, left)
        return rates

    def learned(self, x: JaxArray) -> JaxArray:
        """Return psi (2, batch) in Vs at currents x (2, batch) in A, averaged over the angle."""
        return self.flux.flux_and_inductance(x)[0]

    def stored(self, x: JaxArray) -> JaxArray:
        """Return psi (2, batch) in Vs: errors in this domain are voltages, integrated."""
        return self.learned(x)

    def maps(self) -> Mapping[str, Callable[..., Any]]:
        """Return ``flux_map`` and ``differential_inductance`` as functions of i_d, i_q in A."""
        return {
            "flux_map": lambda i_d, i_q: _evaluate(self, i_d, i_q)[0],
            "differential_inductance": lambda i_d, i_q: _evaluate(self, i_d, i_q)[1],
        }


@jax.jit
def _flux(flux: FluxMap, x: JaxArray, theta_el: JaxArray | None) -> Flux:
    """Return the map at an angle; traced once for all stages of a solver."""
    return flux.mean(x) if theta_el is None else flux.at_angle(x, theta_el)


@jax.jit
def _flux_and_inductance(machine: Machine, currents: JaxArray) -> tuple[JaxArray, JaxArray]:
    return with_batch_axis(machine).flux.flux_and_inductance(currents)


def _evaluate(machine: Machine, i_d: Any, i_q: Any) -> tuple[FloatArray, FloatArray]:
    """Return psi (2, *shape) in Vs and L (2, 2, *shape) in H for currents of any one shape."""
    currents = np.stack(np.broadcast_arrays(np.asarray(i_d, float), np.asarray(i_q, float)))
    shape = currents.shape[1:]
    with float64():
        blocks = [
            _flux_and_inductance(machine, part) for part in in_blocks(currents.reshape(2, -1))
        ]
        psi, inductance = (
            np.concatenate([np.asarray(part) for part in parts], axis=-1)[..., : currents[0].size]
            for parts in zip(*blocks, strict=True)
        )
    return psi.reshape(2, *shape), inductance.reshape(2, 2, *shape)
