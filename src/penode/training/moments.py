"""What residuals under noise with outliers weigh: sums over all windows, quantity by quantity."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, on_device
from penode.data.windows import Windows
from penode.training.chunks import Block, over_blocks
from penode.training.noise import StudentT
from penode.training.prediction_error import Batch, PredictionError
from penode.training.sensitivities import Columns, Recursion


def moments(
    error: PredictionError, raw: FloatArray, windows: Windows, corrections: FloatArray
) -> FloatArray:
    """Return `penode.training.noise.StudentT.moments` summed over windows and steps, (3, quantity).

    The windows' starts are corrected, (free, window), SI units.
    """

    def of_block(one: Block) -> FloatArray:
        given = on_device(raw), on_device(error.scale), one.corrections, one.batch
        return np.asarray(_moments(one.error, *given, on_device(one.horizon)))

    return np.asarray(sum(over_blocks(of_block, error, windows, corrections)))


@partial(jax.jit, static_argnums=0)
def _moments(
    error: PredictionError,
    raw: JaxArray,
    scale: JaxArray,
    correction: JaxArray,
    batch: Batch,
    horizon: JaxArray,
) -> JaxArray:
    """Return the sums (3, quantity) over a batch of windows."""
    error = replace(error, scale=scale)
    noise = error.loss.noise or StudentT()
    values = error.layout.values(raw)[:, None]

    def add(k: JaxArray, residual: JaxArray, slopes: Columns, sums: JaxArray) -> JaxArray:
        z = noise.unweighted(residual)
        return sums + jnp.sum(noise.moments(z) * batch.used, axis=-1)

    nothing = jnp.zeros((3, len(error.compared)), values.dtype)
    recursion = Recursion(error, error.layout.split(values), horizon, batch, 0)
    return recursion.over_steps(correction, add, nothing)
