"""Terms of the voltage equation: what takes up voltage before the flux linkage changes.

Each term is stated once, as the voltage that drops across it::

    u = sum over terms of drop(i, u, psi) + L di/dt

The predictor solves this for di/dt (`penode.pmsm.machine.model.Machine`); the weak form takes its
columns from the same `drop` (`penode.pmsm.balance.voltage_balance`). To add a term, write a
subclass of `Term` and register it in `penode.pmsm.machine.term_registry.TERMS`.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray, Leaf
from penode.models.inputs import Inputs
from penode.models.parameters import physical
from penode.pmsm.machine.flux_maps import Flux
from penode.pmsm.machine.frames import quarter_turned


@dataclass(frozen=True)
class Channel:
    """A channel that a term or a map needs beside voltages and currents.

    Attributes
    ----------
    name : str
        Of the channel in a recording.
    unit : str
        Unit of its values.
    meaning : str
        What it is, for messages.
    lowest, highest : float
        Range of credible values; what lies outside is refused.
    rate : str
        The channel that is its rate of change, for one that goes on between samples; empty for
        none.
    """

    name: str
    unit: str
    meaning: str
    lowest: float = -np.inf
    highest: float = np.inf
    rate: str = ""


SPEED = Channel("omega_el", "rad/s", "the electrical speed")
ANGLE = Channel("theta_el", "rad", "the electrical angle of the rotor", rate="omega_el")
#: Temperature in degC that a resistance over temperature is stated at.
REFERENCE = 20.0
TEMPERATURE = Channel("winding_temperature", "degC", "the temperature of the winding", -60, 300)
MAGNETS = Channel("magnet_temperature", "degC", "the temperature of the magnets", -60, 300)


class Term(eqx.Module):
    """One summand of the voltage equation, with its own parameters and channels.

    Parameters are fields, declared as in any `penode.Model`. The drop is linear in those that are
    physical; the weak form estimates them, and holds all others where `prepared` puts them.

    Class attributes
    ----------------
    role : str
        What the term describes; a machine has at most one of a role.
    title : str
        The same at the beginning of a sentence.
    channels : tuple of Channel
        Inputs that `drop` reads beside u_d and u_q.
    induced : bool
        Whether turning induces the drop, so that its power over the speed is torque.
    """

    role: ClassVar[str]
    title: ClassVar[str]
    channels: ClassVar[tuple[Channel, ...]] = ()
    induced: ClassVar[bool] = False

    @abstractmethod
    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return the voltage across the term.

        Parameters
        ----------
        x : array, shape (2, batch)
            i_d and i_q in A.
        u : Inputs, rows of shape (batch,)
            u_d and u_q in V, and the channels in their units.
        flux : Flux
            Flux linkage in Vs, inductance in H and slope over the angle in Vs/rad. The weak form
            integrates the whole change of the flux linkage, that with the angle included, and gives
            an inductance and a slope of 0. It takes the drop as linear in psi, at the values that
            the parameters start from: one that multiplies psi is not identified there.

        Returns
        -------
        array, shape (2, batch)
            d and q component in V.
        """

    def prepared(self, largest_current: float) -> Self:
        """Return the term with guesses for parameters that are not set.

        Parameters
        ----------
        largest_current : float
            Of the recordings, in A.
        """
        return self


class Resistance(Term):
    """R i.

    Attributes
    ----------
    R : array, shape ()
        Stator resistance in ohm.
    """

    role: ClassVar[str] = "resistance"
    title: ClassVar[str] = "The resistance"

    R: Leaf = physical("ohm", default=0.0, meaning="stator resistance", lowest=0.0)

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return R i in V; see `Term.drop`."""
        return self.R * x


class TemperatureResistance(Term):
    """R (1 + alpha (T - 20)) i at the winding's recorded temperature T in degC.

    Attributes
    ----------
    R : array, shape ()
        Stator resistance at 20 degC in ohm.
    alpha : float
        Temperature coefficient in 1/K at 20 degC; that of annealed copper (IEC 60028) by default.
    """

    role: ClassVar[str] = "resistance"
    title: ClassVar[str] = "The resistance over temperature"
    channels: ClassVar[tuple[Channel, ...]] = (TEMPERATURE,)

    R: Leaf = physical("ohm", default=0.0, meaning="stator resistance at 20 °C", lowest=0.0)
    alpha: float = eqx.field(static=True, default=3.93e-3)

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return R(T) i in V; see `Term.drop`."""
        return self.R * (1.0 + self.alpha * (u[TEMPERATURE.name] - REFERENCE)) * x


class MagnetTemperature(Term):
    """omega J k (T - 20): what magnets at T in degC add to the induced voltage of those at 20 degC.

    Attributes
    ----------
    magnet_coefficient : array, shape ()
        k, by which the magnets' flux linkage grows a kelvin, in Vs/K; below zero for most.
    """

    role: ClassVar[str] = "temperature of the magnets"
    title: ClassVar[str] = "The magnets' flux linkage over temperature"
    channels: ClassVar[tuple[Channel, ...]] = (SPEED, MAGNETS)
    induced: ClassVar[bool] = True

    magnet_coefficient: Leaf = physical(
        "Vs/K", default=0.0, meaning="flux linkage of the magnets a kelvin"
    )

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return omega J (k (T - 20), 0) in V; see `Term.drop`."""
        more = self.magnet_coefficient * (u[MAGNETS.name] - REFERENCE)
        return u[SPEED.name] * jnp.stack([jnp.zeros_like(more), more])


class Rotation(Term):
    """omega (J psi + d psi / d theta): the voltage that turning induces."""

    role: ClassVar[str] = "rotation"
    title: ClassVar[str] = "The induced voltage"
    channels: ClassVar[tuple[Channel, ...]] = (SPEED,)
    induced: ClassVar[bool] = True

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return omega (J psi + d psi / d theta) in V; see `Term.drop`."""
        turned: JaxArray = quarter_turned(flux.linkage) + flux.angle_slope
        return u[SPEED.name] * turned
