"""Gauss-Newton terms of a loss over windows, and the scale of its residuals."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, float64
from penode.models.base import Model
from penode.models.parameters import with_batch_axis
from penode.training.loss import Loss, channel_deviation


@dataclass(frozen=True, eq=False)
class GaussNewtonTerms:
    """Sums over windows w and steps k of the residual r and its sensitivity S = -dr/dtheta.

    Penalties of the loss are in all of them but the scores.

    Attributes
    ----------
    loss : float
        Mean squared residual over windows, steps and states (paper, training loss).
    count : int
        Number of residuals summed.
    normal : ndarray, shape (parameter, parameter)
        Sum of S'S.
    descent : ndarray, shape (parameter,)
        Sum of S'r: minus half the gradient of the summed squares.
    scores : ndarray, shape (parameter, window)
        S'r summed over the steps of each window.
    prior : ndarray, shape (parameter, parameter), or 0
        Variance of Gaussian priors, to add to the covariance of the summed scores.
    """

    loss: float
    count: int
    normal: FloatArray
    descent: FloatArray
    scores: FloatArray
    prior: FloatArray | float = 0.0

    @property
    def finite(self) -> bool:
        """Whether no rollout diverged."""
        return bool(np.isfinite(self.loss) and np.isfinite(self.normal).all())


def residual_scale(model: Model, visited: FloatArray, loss: Loss) -> FloatArray:
    """Return what residuals are divided by, shape (quantity,), in the loss's domain.

    Parameters
    ----------
    model : Model
        At its start.
    visited : ndarray, shape (time, state)
        Recorded states, SI units.
    loss : Loss
        Its `scale`; by default 1 if the states share a unit and else the channels' deviations.
    """
    with float64():
        quantity = np.asarray(loss.domain(with_batch_axis(model), jnp.asarray(visited.T)))
    if loss.scale is None and len(set(model.state_units)) == 1:
        return np.ones(len(quantity))
    scale = loss.scale or channel_deviation
    return np.asarray(np.maximum(scale(quantity.T), 1e-300))
