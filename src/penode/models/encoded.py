"""An encoder around a model: windows start where their past samples say."""

from collections.abc import Sequence
from typing import Protocol

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf
from penode.errors import InputError
from penode.models.base import Model
from penode.models.measured import measured_units
from penode.models.networks import dense
from penode.models.parameters import parameter
from penode.models.wrapped import Wrapped

#: Group of the encoder's weights.
GROUP = "encoder"
#: Ratio of time steps that are the same.
_ALIKE = 1.0001


class _Recording(Protocol):
    @property
    def time_step(self) -> float: ...
    def stack(self, channels: tuple[str, ...]) -> FloatArray: ...


class Encoded(Wrapped):
    """A model with an encoder: one map from past samples to the state where a window starts.

    Without it each window estimates its own start, which takes as many of its values as there are
    states and a search for every window. An encoder is shared by all windows and trained with all
    other parameters (SUBNET, doi:10.1016/j.automatica.2023.111210): x(t) is linear in what was
    measured and in the inputs at the samples t - past + 1 .. t, each less its mean and over its
    deviation, plus a layer of tanh neurons where it has any. Training begins at the measured states
    and at zero for all others. Free runs start from an estimate, as a recording has no past.

    Parameters
    ----------
    model : Model
    experiments : sequence of penode.Experiment
        Recordings of one time step, whose channels are scaled.
    past : int
        Samples that the encoder sees, the window's first among them; a few more than it takes to
        show each state.
    neurons : int, default 0
        Of its tanh layer, where outputs are not linear in the states.
    seed : int, default 0
        Of that layer's weights.

    Raises
    ------
    InputError
        If a channel is missing, a count is out of range, the model has noise on its states, or time
        steps differ.
    """

    past: int
    means: tuple[float, ...] = eqx.field(static=True)
    deviations: tuple[float, ...] = eqx.field(static=True)
    weights: Leaf = parameter(group=GROUP)
    layer: Leaf | None = parameter(group=GROUP, default=None)
    gains: Leaf | None = parameter(group=GROUP, default=None)

    def __init__(
        self,
        model: Model,
        experiments: Sequence[_Recording],
        past: int,
        neurons: int = 0,
        seed: int = 0,
    ):
        if past < 1 or neurons < 0:
            raise InputError(f"past must be >= 1 and neurons >= 0, got {past} and {neurons}.")
        if model.covariances:
            raise InputError(
                f"Encoded must be around a model without noise on its states, got "
                f"{type(model).__name__}, which estimates the windows' starts; use one of them."
            )
        steps = [one.time_step for one in experiments]
        if max(steps) > _ALIKE * min(steps):
            raise InputError(
                f"recordings of one encoder must have one time step, got {min(steps):.6g} and "
                f"{max(steps):.6g} s; leave the encoder out."
            )
        self.model, self.past = model, past
        measured = tuple(measured_units(model))
        stacked = np.concatenate([e.stack((*measured, *model.inputs)) for e in experiments])
        deviations = np.std(stacked, axis=0)
        deviations = np.where(deviations > 0, deviations, 1.0)
        means = np.mean(stacked, axis=0)
        self.means, self.deviations = tuple(means.tolist()), tuple(deviations.tolist())
        features = 1 + past * len(means)
        weights = np.zeros((len(model.states), features))
        for row, name in enumerate(model.states):
            if name in measured:
                at = measured.index(name)
                weights[row, [0, 1 + at]] = means[at], deviations[at]
        self.weights, self.layer, self.gains = weights, None, None
        if neurons:
            random, bound = np.random.default_rng(seed), features**-0.5
            self.layer = random.uniform(-bound, bound, (neurons, features))
            self.gains = np.zeros((len(model.states), neurons))

    @property
    def encoded_samples(self) -> int:
        """Samples that the encoder sees."""
        return self.past

    def encoded(self, measured: JaxArray, inputs: JaxArray) -> JaxArray:
        """Return the states (state, batch) by (sample, row, batch), the newest sample first."""
        given = jnp.concatenate([measured, inputs[:, : len(self.model.inputs)]], axis=1)
        centred = given - _column(self.means)
        scaled = (centred / _column(self.deviations)).reshape(-1, given.shape[-1])
        features = jnp.concatenate([jnp.ones_like(scaled[:1]), scaled])
        start = dense(jnp.asarray(self.weights), features)
        if self.layer is None:
            return start
        hidden = jnp.tanh(dense(jnp.asarray(self.layer), features))
        return start + dense(jnp.asarray(self.gains), hidden)


def _column(numbers: Sequence[float]) -> FloatArray:
    return np.array(numbers)[:, None]
