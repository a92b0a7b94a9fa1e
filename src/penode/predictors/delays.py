"""Inputs that act late: a drive whose rows lie as far back as parameters of the model say."""

import equinox as eqx
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.parameters import delays_of
from penode.predictors.holds import Drive


class Recorded(eqx.Module):
    """The drive of recorded inputs (row, time) around samples `at` (batch,)."""

    inputs: JaxArray
    at: JaxArray
    # Where the recordings begin: one sample, or that of each (batch,).
    begin: JaxArray | int = 0
    # Rows a sample in a table of sub-steps, and the one that is read.
    count: JaxArray | int = 1
    number: JaxArray | int = 0

    def __call__(self, offset: int | JaxArray) -> JaxArray:
        """Return the input (row, batch) at so many samples after `at`."""
        return self.inputs[:, (self.at + offset) * self.count + self.number]

    def back(self, offset: JaxArray, channels: int) -> JaxArray:
        """Return the same at any offset: before the first sample its channels, held."""
        at = self.at + offset
        within = self.inputs[:, jnp.maximum(at, self.begin) * self.count + self.number]
        first = self.inputs[:channels, self.begin * self.count + 0 * at]
        before = jnp.tile(first, (len(self.inputs) // channels, 1))
        return jnp.where(at < self.begin, before, within)


def delayed(model: Model, drive: Drive, time_step: float) -> Drive:
    """Return the drive as it acts: delayed inputs as many s later as the model's parameters say.

    Between two samples an input is taken in proportion. Of one that is held constant that is its
    mean over each sample, of a ramp its value.
    """
    delays = delays_of(model)
    if not delays:
        return drive
    names = driving_channels(model)

    def back(offset: JaxArray) -> JaxArray:
        return drive.back(offset, len(names)) if isinstance(drive, Recorded) else drive(offset)

    def late(offset: int | JaxArray) -> JaxArray:
        rows = back(jnp.asarray(offset))
        for name, delay in delays:
            whole = jnp.floor(delay / time_step)
            part, at = delay / time_step - whole, offset - whole.astype(int)
            own = slice(names.index(name), None, len(names))
            rows = rows.at[own].set((1 - part) * back(at)[own] + part * back(at - 1)[own])
        return rows

    return late


def as_acting(model: Model, inputs: JaxArray, time_step: float) -> JaxArray:
    """Return a record of a model's driving channels (channel, time) as they act."""
    if not delays_of(model):
        return inputs
    return delayed(model, Recorded(inputs, jnp.arange(inputs.shape[1])), time_step)(0)
