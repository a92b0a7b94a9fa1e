"""States of windows as the model has them: their estimated starts, and what follows from these."""

from dataclasses import replace
from functools import partial
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.data.windows import Windows
from penode.predictors.rollout import rollout
from penode.training.free_starts import estimated_starts
from penode.training.prediction_error import Batch, PredictionError, compiled_windows

#: By sample, the sum of states (state, time) and of how many windows (time,).
_Sums: TypeAlias = tuple[JaxArray, JaxArray]
#: Windows that go through together: one program serves any number of them.
_BLOCK = 256


def start_states(error: PredictionError, raw: FloatArray, windows: Windows) -> FloatArray:
    """Return the states (window, state) at the windows' starts, those that are free estimated."""
    starts = [starts for starts, _, _ in _blocks(error, raw, windows)]
    return np.concatenate(starts, axis=1)[:, : len(windows)].T


def mean_states(error: PredictionError, raw: FloatArray, windows: Windows) -> FloatArray:
    """Return the mean over windows of each sample's predicted states, (time, state).

    Samples that no window passes are nan.
    """
    blocks = _blocks(error, raw, windows)
    total, count = (np.sum([block[k] for block in blocks], axis=0) for k in (1, 2))
    samples = len(windows.states)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((total / count)[:, :samples].T)


def _blocks(
    error: PredictionError, raw: FloatArray, windows: Windows
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return starts, summed states and how many were summed, of blocks of windows."""
    found = []
    for first in range(0, len(windows), _BLOCK):
        few = windows.among(slice(first, first + _BLOCK))
        with float64():
            batch = compiled_windows(error, few, _BLOCK)
            given = on_device(raw), on_device(error.scale), batch, on_device(few.horizon)
            starts, total, count = _followed(error, *given)
            found.append((np.asarray(starts), np.asarray(total), np.asarray(count)))
    return found


@partial(jax.jit, static_argnums=0)
def _followed(
    error: PredictionError, raw: JaxArray, scale: JaxArray, batch: Batch, horizon: JaxArray
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Return the starts (state, batch), and by sample the sum of predicted states and windows."""
    values = error.layout.values(raw)[:, None]
    correction = estimated_starts(replace(error, scale=scale), values, horizon, batch)
    parts = error.layout.split(values)
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
