"""Scores by sample: what each sample of a recording contributed, over all windows that it is in.

Where few windows fit a recording, as long ones do, sums over windows cannot show how residuals are
correlated. The samples within them can.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, on_device
from penode.data.windows import Windows
from penode.native.normal_matrix import NormalMatrix
from penode.training.chunks import Block, over_blocks, summed
from penode.training.free_starts import followed_by
from penode.training.prediction_error import Batch, PredictionError
from penode.training.sensitivities import Columns, Recursion, along


def sample_scores(
    error: PredictionError, raw: FloatArray, windows: Windows, starts: FloatArray | None = None
) -> FloatArray:
    """Return S'r by the sample predicted, (value, sample), the windows' starts eliminated.

    Their sum over samples is that of the windows' scores. Corrections of the starts (free, window)
    are estimated if left out.
    """
    corrections = summed(error, raw, windows, normal=False).starts if starts is None else starts

    def of_block(one: Block) -> FloatArray:
        given = on_device(raw), on_device(error.scale), one.corrections, one.batch
        return np.asarray(_by_sample(one.error, *given, one.horizon))

    total = sum(over_blocks(of_block, error, windows, corrections))
    return np.asarray(total)[:, : len(windows.states)]


@partial(jax.jit, static_argnums=0)
def _by_sample(
    error: PredictionError,
    raw: JaxArray,
    scale: JaxArray,
    correction: JaxArray,
    batch: Batch,
    horizon: JaxArray,
) -> JaxArray:
    """Return the scores (value, sample) of a batch of windows, whose starts are corrected."""
    error = replace(error, scale=scale)
    values = error.layout.values(raw)
    size, width = len(values), len(batch.starts)
    each = jnp.broadcast_to(values[:, None], (size, width))
    sums = jnp.zeros((size, batch.states.shape[1]), values.dtype)
    normal = NormalMatrix.zero(size, values)
    follow = followed_by(error, values[:, None], correction, horizon, batch, normal)

    def add(k: JaxArray, residual: JaxArray, slopes: Columns, sums: JaxArray) -> JaxArray:
        return sums.at[:, batch.starts + k + 1].add(along(residual, slopes.shared))

    recursion = Recursion(error, error.layout.split(each), horizon, batch, size, follow)
    sums = recursion.over_steps(correction, add, sums)
    if len(error.free):
        held, slopes = error.held(correction)
        sums = sums.at[:, batch.starts].add(along(slopes * held * batch.used, follow))
    return sums
