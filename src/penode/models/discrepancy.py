"""A model beside which something is left over: a smooth function of states and (past) inputs."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray, Leaf
from penode.models.explicit_time import driving_channels, evaluated
from penode.models.inputs import Inputs
from penode.models.parameters import parameter
from penode.models.splines import cubic_kernel
from penode.models.wrapped import Wrapped

#: Groups of the coefficients, and of what never moves.
GROUP, HELD = "discrepancy", "held"
#: What an input acts by: itself, what it changed by in a sample, and two first-order lags of it.
ACTS = ("", "change of ", "short lag of ", "long lag of ")


class Discrepant(Wrapped):
    """A model whose derivative lacks a sum of cubic splines, each of one channel.

    Channels are the states, the inputs, and, as further inputs, what these changed by in a sample
    and lags of them: modes that were neglected answer to these, fast ones and slow ones. Between
    `low` and `high` (channel,) each was recorded, SI units. The coefficients (rate, channel,
    cells + 3), zero where nothing is left over, are in units of `scale` (rate,), SI units per
    second, of the derivatives of the states at the places `rates`.
    """

    rates: tuple[int, ...] = eqx.field(static=True)
    coefficients: Leaf = parameter(group=GROUP)
    # Numbers of a recording are arguments of compiled code: it serves the next recording too.
    scale: Leaf = parameter(group=HELD)
    low: Leaf = parameter(group=HELD)
    high: Leaf = parameter(group=HELD)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of what drives the model, and of its past."""
        own = driving_channels(self.model)
        return tuple(f"{how}{name}" for how in ACTS for name in own)

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the model's derivative and what it lacks, (state, batch)."""
        rate = evaluated(self.model, "derivative", x, self._own(u))
        width = max(x.shape[-1], u.values.shape[-1])
        channels = jnp.concatenate(
            [jnp.broadcast_to(part, (len(part), width)) for part in (x, u.values)]
        )
        basis = spline_basis(channels, self.low, self.high, self.coefficients.shape[2] - 3)
        for k, at in enumerate(self.rates):
            lacking = jnp.sum(self.coefficients[k] * basis, axis=(0, 1))
            rate = rate.at[at].add(self.scale[k] * lacking)
        return rate

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return what sensors read of the model."""
        return evaluated(self.model, "output", x, self._own(u))

    def _own(self, u: Inputs) -> Inputs:
        """Return what drives the model, without its past."""
        return u.leading(driving_channels(self.model))


def spline_basis(channels: JaxArray, low: Leaf, high: Leaf, cells: int) -> JaxArray:
    """Return cubic B-splines (channel, cells + 3, batch) of channels (channel, batch).

    Beyond its range from low to high, (channel, batch or 1), a channel stays where it ends.
    """
    place = jnp.clip((channels - low) / (high - low), 0.0, 1.0) * cells
    return cubic_kernel(place[:, None] - np.arange(-1, cells + 2)[:, None])[0]
