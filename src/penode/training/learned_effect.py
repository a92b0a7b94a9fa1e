"""What the learned part of a model adds to the derivative where the recordings have been."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import BoolArray, FloatArray, JaxArray, float64, on_device, with_shared_length
from penode.data.windows import Windows
from penode.models.base import Model
from penode.models.explicit_time import driving_channels, evaluated
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.models.measured import dynamic_states
from penode.training.prediction_error import PredictionError
from penode.training.window_states import start_states

#: Starts of windows at which the model is looked at.
_VISITS, _SHORTEST = 1000, 128
#: Steps for each state from which the start of a window is estimated.
_STEPS = 8
#: A channel matters if the map changes by more than this fraction when the channel does.
_MATTERS = 1e-6


@dataclass(frozen=True, eq=False)
class Visits:
    """States (visit, state) and inputs (visit, input), SI, at windows' starts as estimated."""

    states: FloatArray
    inputs: FloatArray

    @classmethod
    def of(cls, error: PredictionError, raw: FloatArray, windows: Windows) -> "Visits":
        """Return some hundred visits evenly over the recordings, free starts estimated at `raw`."""
        few = _evenly(windows, min(windows.horizon, _STEPS * windows.states.shape[1]))
        states = start_states(error, raw, few)
        return cls(states, few.inputs[few.starts, : len(driving_channels(error.model))])

    @property
    def channels(self) -> FloatArray:
        """States and inputs beside each other, shape (visit, channel)."""
        return np.concatenate([self.states, self.inputs], axis=1)

    def at(self, channels: FloatArray) -> "Visits":
        """Return visits of other channels (visit, channel)."""
        states = self.states.shape[1]
        return Visits(channels[:, :states], channels[:, states:])


def _evenly(windows: Windows, horizon: int) -> Windows:
    """Return short windows that begin evenly between the first and the last of each recording."""
    spans = [
        (number, windows.starts[windows.recording == number])
        for number in np.unique(windows.recording)
    ]
    lengths = [int(np.ptp(starts)) + 1 for _, starts in spans]
    counts = [max(min(_VISITS * length // sum(lengths), length), 1) for length in lengths]
    starts = [
        np.linspace(s.min(), s.max(), count).astype(int)
        for (_, s), count in zip(spans, counts, strict=True)
    ]
    recording = [np.full(len(s), n) for s, (n, _) in zip(starts, spans, strict=True)]
    places = np.concatenate(starts), np.concatenate(recording)
    return replace(windows, starts=places[0], recording=places[1], horizon=horizon)


@dataclass(frozen=True, eq=False)
class LearnedEffect:
    """The learned part of a model in its derivative, about given values.

    All is in units of the derivative's deviation over the visits, state by state.
    """

    layout: Layout[Model]
    values: FloatArray
    # Deviations of the derivatives, (state,), SI units per second.
    scale: FloatArray

    @classmethod
    def of(cls, layout: Layout[Model], raw: FloatArray, visits: Visits) -> "LearnedEffect":
        """Return the effect about raw parameters (parameter,)."""
        with float64():
            values = np.asarray(layout.values(jnp.asarray(raw)))
            rate = np.asarray(_derivative(layout, on_device(values), *_columns(visits)))
        rate = rate[:, : len(visits.states)]
        return cls(layout, values, np.maximum(np.sqrt(np.mean(rate**2, axis=1)), 1e-300))

    def at(self, visits: Visits) -> tuple[FloatArray, FloatArray]:
        """Return the effect (state, visit) and its slopes by the learned values, (..., learned)."""
        with float64():
            given = self.layout, on_device(self.values), *_columns(visits)
            both = (np.asarray(part) for part in _effect(*given))
        effect, slopes = (part[:, : len(visits.states)] for part in both)
        learned = self.layout.value_members(("learned",))
        return effect / self.scale[:, None], slopes[..., learned] / self.scale[:, None, None]

    def by_values(self, visits: Visits) -> FloatArray:
        """Return the derivative's slopes by all values, (state, visit, value)."""
        with float64():
            given = self.layout, on_device(self.values), *_columns(visits)
            slopes = np.asarray(_slopes(*given))[:, : len(visits.states)]
        return slopes / self.scale[:, None, None]

    def physical(self, visits: Visits) -> FloatArray:
        """Return the derivative's slopes by what is not learned, (state, visit, value)."""
        return self.by_values(visits)[..., ~self.layout.value_members(("learned",))]

    def channels(self, visits: Visits, seed: int = 0) -> BoolArray:
        """Return which states and inputs the map depends on, shape (channel,)."""
        draw = np.random.default_rng(seed)
        given = visits.channels
        slopes = self.at(visits)[1]
        size = np.abs(slopes).max(axis=(0, 1))
        matters = np.zeros(given.shape[1], bool)
        for k in range(given.shape[1]):
            other = given.copy()
            other[:, k] = draw.permutation(given[:, k])
            change = np.abs(self.at(visits.at(other))[1] - slopes).max(axis=(0, 1))
            matters[k] = np.any(change > _MATTERS * np.maximum(size, 1e-300))
        return matters


def _columns(visits: Visits) -> tuple[JaxArray, JaxArray]:
    """Return states and inputs (channel, visit), padded: few programs serve any number."""
    states, inputs = (
        with_shared_length(part.T, shortest=_SHORTEST) for part in (visits.states, visits.inputs)
    )
    return states, inputs


def _rate(layout: Layout[Model], values: JaxArray, x: JaxArray, u: JaxArray) -> JaxArray:
    """Return the derivative (state, visit) at values (value, visit or 1)."""
    model = layout.model(values)
    rate = evaluated(model, "derivative", x, Inputs(u, driving_channels(model)))
    return rate[: len(dynamic_states(model))]


@partial(jax.jit, static_argnums=0)
def _derivative(layout: Layout[Model], values: JaxArray, x: JaxArray, u: JaxArray) -> JaxArray:
    return _rate(layout, values[:, None], x, u)


@partial(jax.jit, static_argnums=0)
def _slopes(layout: Layout[Model], values: JaxArray, x: JaxArray, u: JaxArray) -> JaxArray:
    """Return the derivative's slopes by the values, (state, visit, value), one product a state."""
    own = jnp.broadcast_to(values[:, None], (len(values), x.shape[1]))
    rate, pull_back = jax.vjp(lambda values: _rate(layout, values, x, u), own)
    units = jnp.broadcast_to(jnp.eye(len(rate))[..., None], (len(rate), *rate.shape))
    return jnp.swapaxes(jax.vmap(pull_back)(units)[0], 1, 2)


@partial(jax.jit, static_argnums=0)
def _effect(
    layout: Layout[Model], values: JaxArray, x: JaxArray, u: JaxArray
) -> tuple[JaxArray, JaxArray]:
    """Return the derivative less that without a learned part, and its slopes by the values."""
    without = jnp.where(layout.value_members(("learned",)), 0.0, values)
    rate = partial(_rate, layout, x=x, u=u)
    effect = rate(values[:, None]) - rate(without[:, None])
    return effect, _slopes(layout, values, x, u)
