"""Models of the public sets with a learned part inside their physics.

Each learned part stands beside the law of the textbook (but for the inductance, which it replaces),
starts at zero and is a spline over the range that the recordings cover.
"""

from dataclasses import fields
from typing import Any

import jax.numpy as jnp

from penode import Model, physical
from penode.arrays import JaxArray
from penode.engine import Positive, Spline
from penode.models.inputs import Inputs
from validate.examples import example

Circuit = example("01_rlc").Circuit
Positioner = example("02_emps").Positioner
TemperatureLab = example("03_tclab").TemperatureLab
Tanks = example("06_tanks").Tanks
CubicSpring = example("07_silverbox").CubicSpring
Hysteresis = example("08_bouc_wen").Hysteresis


def over(low: float, high: float, outputs: int = 1, cells: int = 10) -> Spline:
    """Return a spline in one input that is zero."""
    return Spline.zero((low,), (high,), (cells,), outputs)


class Inductance(Model):
    """The circuit with log L(i) an even spline in place of the knee."""

    states = Circuit.states
    state_units = Circuit.state_units
    inputs = Circuit.inputs
    curve: Spline
    R: Any = physical("ohm", Positive())
    C: Any = physical("F", Positive())

    def learned(self, x: JaxArray) -> JaxArray:
        """Return L (1, batch) in H."""
        return 50e-6 * jnp.exp(self.curve.value_and_jacobian(jnp.abs(x[1:]))[0])

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of v and i."""
        return jnp.stack([x[1] / self.C, (u[0] - x[0] - self.R * x[1]) / self.learned(x)[0]])


class Outflow(Tanks):
    """Both outflows, the overflow and what of it arrives below are corrected."""

    above: Spline
    below: Spline

    def learned(self, x: JaxArray) -> JaxArray:
        """Return the flows out of the upper tank, into and out of the lower one (3, batch)."""
        parts = self.above.value_and_jacobian(x[:1])[0], self.below.value_and_jacobian(x[1:])[0]
        return jnp.concatenate(parts)

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of the levels."""
        out, into, lost = self.learned(x)
        return super().derivative(x, u) + jnp.stack([-out, into - lost])


class SpringAndDamping(CubicSpring):
    """A spring over the position and a damping over the speed beside the textbook's."""

    spring: Spline
    damping: Spline

    def learned(self, x: JaxArray) -> JaxArray:
        """Return both forces over the mass (2, batch)."""
        parts = self.spring.value_and_jacobian(x[:1])[0], self.damping.value_and_jacobian(x[1:])[0]
        return jnp.concatenate(parts)

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return speed and acceleration."""
        y, v = super().derivative(x, u)
        return jnp.stack([y, v - self.learned(x).sum(axis=0)])


class LearnedHysteresis(Hysteresis):
    """z' = (alpha - lead(z)) y' - lag(z) |y'| beside Bouc and Wen's law."""

    loop: Spline

    def learned(self, x: JaxArray) -> JaxArray:
        """Return lead and lag over the force z (2, batch)."""
        return self.loop.value_and_jacobian(x[2:])[0]

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return speed, acceleration and the rate of the restoring force."""
        y, v, z = super().derivative(x, u)
        lead, lag = self.learned(x)
        return jnp.stack([y, v, z - lead * x[1] - lag * jnp.sqrt(x[1] ** 2 + 1e-12)])


class Friction(Positioner):
    """A friction over the speed beside the textbook's."""

    curve: Spline

    def learned(self, x: JaxArray) -> JaxArray:
        """Return the force (1, batch) in N."""
        return self.curve.value_and_jacobian(x[1:])[0]

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of q and v."""
        q, v = super().derivative(x, u)
        return jnp.stack([q, v - self.learned(x)[0] / self.M])


class LossToAmbient(TemperatureLab):
    """A loss to the room over the heater's temperature beside convection and radiation."""

    curve: Spline

    def learned(self, x: JaxArray) -> JaxArray:
        """Return what both heaters lose (2, batch) in W."""
        both = [self.curve.value_and_jacobian(x[k : k + 1])[0] for k in (2, 3)]
        return jnp.concatenate(both)

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of the sensors' and the heaters' temperatures."""
        return super().derivative(x, u) - jnp.concatenate([0.0 * x[:2], self.learned(x) / 2.0])


def _beside(make: type[Model], start: Model, **parts: Spline) -> Model:
    """Return a model with learned parts that begins where a textbook's model does."""
    known = {one.name: getattr(start, one.name) for one in fields(start)}
    return make(**known, **parts)


#: For each name a function from the textbook's start to that of the model with a learned part.
LEARNED = {
    "rlc+inductance": lambda start: Inductance(over(0.0, 20.0), start.R, start.C),
    "tanks+outflow": lambda start: _beside(
        Outflow, start, above=over(0.0, 14.0, 2), below=over(0.0, 11.0)
    ),
    "silverbox+spring": lambda start: _beside(
        SpringAndDamping, start, spring=over(-0.25, 0.25), damping=over(-100.0, 100.0)
    ),
    "bouc_wen+hysteresis": lambda start: _beside(
        LearnedHysteresis, start, loop=over(-150.0, 150.0, 2)
    ),
    "emps+friction": lambda start: _beside(Friction, start, curve=over(-0.14, 0.14)),
    "tclab+loss": lambda start: _beside(LossToAmbient, start, curve=over(290.0, 340.0)),
}
