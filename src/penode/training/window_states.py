"""States of windows as the model has them: their estimated starts, and what follows from these."""

from collections.abc import Iterator
from functools import partial
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, IntArray, JaxArray, on_device
from penode.data.windows import Windows
from penode.predictors.rollout import rollout
from penode.training.chunks import Block, over_blocks, summed
from penode.training.prediction_error import Batch, PredictionError

#: By sample, the sum of states (state, time) and of how many windows (time,).
_Sums: TypeAlias = tuple[JaxArray, JaxArray]


def start_states(error: PredictionError, raw: FloatArray, windows: Windows) -> FloatArray:
    """Return the states (window, state) at the windows' starts, those that are free estimated."""
    found = np.empty((len(windows), len(error.model.states)))
    for places, starts, _, _ in _blocks(error, raw, windows, None):
        found[places] = starts[:, : len(places)].T
    return found


def mean_states(
    error: PredictionError,
    raw: FloatArray,
    windows: Windows,
    corrections: FloatArray | None = None,
) -> FloatArray:
    """Return the mean over windows of each sample's predicted states, (time, state).

    Corrections (free, window) of the starts are estimated if left out. Samples that no window
    passes are nan.
    """
    total, count = np.zeros(()), np.zeros(())
    for _, _, own, often in _blocks(error, raw, windows, corrections):
        total, count = total + own, count + often
    samples = len(windows.states)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((total / count)[:, :samples].T)


def _blocks(
    error: PredictionError, raw: FloatArray, windows: Windows, known: FloatArray | None
) -> Iterator[tuple[IntArray, FloatArray, FloatArray, FloatArray]]:
    """Yield places, starts, summed states and how many were summed, of blocks of windows."""
    corrections = summed(error, raw, windows, normal=False).starts if known is None else known

    def of_block(one: Block) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        own = one.corrections, one.batch, on_device(one.horizon)
        starts, total, count = map(np.asarray, _followed(one.error, on_device(raw), *own))
        return one.places, starts, total, count

    return over_blocks(of_block, error, windows, corrections)


@partial(jax.jit, static_argnums=0)
def _followed(
    error: PredictionError, raw: JaxArray, correction: JaxArray, batch: Batch, horizon: JaxArray
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Return the starts (state, batch), and by sample the sum of predicted states and windows."""
    parts = error.layout.split(error.layout.values(raw)[:, None])
    start = error.start(parts, correction, batch)

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        return error.step(parts, history, k, batch), None

    def added(k: JaxArray | int, state: JaxArray, sums: _Sums) -> _Sums:
        at = batch.starts + k
        return sums[0].at[:, at].add(state * batch.used), sums[1].at[at].add(batch.used)

    def visit(k: JaxArray, history: JaxArray, _: None, sums: _Sums) -> _Sums:
        return added(k + 1, history[0], sums)

    nothing = jnp.zeros_like(batch.states), jnp.zeros_like(batch.states[0])
    total, count = rollout(step, start, horizon, visit, added(0, start[0], nothing))
    return start[0], total, count
