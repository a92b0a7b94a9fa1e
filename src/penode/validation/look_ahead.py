"""Every sample of a recording, predicted from measured ones some steps before it."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, on_device, shared_length, with_shared_length
from penode.models.base import Model
from penode.predictors.base import Predictor
from penode.predictors.delays import Recorded
from penode.predictors.rollout import rollout

#: Samples that are predicted together: as many rollouts of a learned part stay in the caches.
_TOGETHER = 64


def look_ahead(
    predictor: Predictor,
    model: Model,
    states: JaxArray | FloatArray,
    inputs: JaxArray | FloatArray,
    steps: int,
    stride: int = 1,
) -> FloatArray:
    """Predict every sample from the measured ones `steps` before it (paper, k-step-ahead).

    States (state, time) and inputs (input, time); the model has a batch axis of length 1; steps is
    known at run time only. Every ``stride`` samples give (state, ceil((time - past) / stride)), for
    samples past .. time - 1, of which the first k - 1 start from fewer steps before.
    """
    count = len(range(predictor.past, states.shape[1], stride))
    recorded = [with_shared_length(a) for a in (states, predictor.prepared(np.asarray(inputs).T).T)]
    ahead = _ahead(predictor, model, *recorded, steps, stride)
    return np.asarray(ahead)[:, :count]


@partial(jax.jit, static_argnums=(0, 5))
def _ahead(
    predictor: Predictor,
    model: Model,
    states: JaxArray,
    inputs: JaxArray,
    steps: JaxArray,
    stride: int,
) -> JaxArray:
    """Predict every so many samples of padded rows; see `look_ahead`."""
    past, last = predictor.past, states.shape[1] - 1
    target = jnp.arange(past, last + 1, stride)
    blocks = -(-len(target) // _TOGETHER)

    def block(target: JaxArray) -> JaxArray:
        origin = jnp.maximum(target - steps, past - 1)
        start = jnp.stack([states[:, origin - j] for j in range(past)])

        def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
            at = origin + k
            ahead = predictor.step(model, history, Recorded(inputs, at))
            return jnp.where(at < target, ahead, history), None

        def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
            return history[0]

        return rollout(step, start, steps, visit, start[0])

    padded = jnp.pad(target, (0, blocks * _TOGETHER - len(target)), mode="edge")
    ahead = jax.lax.map(block, padded.reshape(blocks, _TOGETHER))
    return jnp.moveaxis(ahead, 1, 0).reshape(len(states), -1)


def look_far_ahead(
    predictor: Predictor,
    model: Model,
    states: FloatArray,
    inputs: FloatArray,
    least: int,
) -> FloatArray:
    """Predict every sample from measured ones more than `least` steps before it, twice at most.

    As `look_ahead` does, states (state, time) and inputs (input, time) to (state, time - past), but
    in twice as many steps as there are samples, however far it looks. The first `least` samples
    start from the first one.
    """
    samples = states.shape[1]
    windows = shared_length(-(-(samples - predictor.past) // least))
    first = on_device(predictor.past - 1 + least * np.arange(windows))
    recorded = [with_shared_length(a) for a in (states, predictor.prepared(np.asarray(inputs).T).T)]
    ahead = _far_ahead(predictor, model, *recorded, first, least)
    return np.asarray(ahead)[:, predictor.past : samples]


@partial(jax.jit, static_argnums=0)
def _far_ahead(
    predictor: Predictor,
    model: Model,
    states: JaxArray,
    inputs: JaxArray,
    first: JaxArray,
    least: JaxArray,
) -> JaxArray:
    """Let windows of padded rows run side by side, and keep the second half of each."""
    last = states.shape[1] - 1
    at = jnp.minimum(first, last)
    start = jnp.stack([states[:, at - j] for j in range(predictor.past)])

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        return predictor.step(model, history, Recorded(inputs, jnp.minimum(first + k, last))), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        kept = (k >= least) | (jnp.arange(len(first)) == 0)
        place = jnp.where(kept, first + k + 1, last + 1)
        return path.at[:, place].set(history[0], mode="drop")

    return rollout(step, start, 2 * least, visit, states)
