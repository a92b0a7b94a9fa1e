"""Gauss-Newton terms of a loss over windows, and the scale of its residuals."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from penode.arrays import BoolArray, FloatArray, float64, with_shared_length
from penode.models.base import Model
from penode.models.measured import dynamic_states
from penode.models.parameters import with_batch_axis
from penode.training.loss import Loss, channel_deviation

#: Directions of the normal matrix below this fraction of the largest (after scaling) are flat:
#: their estimates are rounding noise, which may swamp those of the others.
FLAT = 1e-10
#: Most parameters of a fit, whose normal matrix is held in several copies.
MOST_PARAMETERS = 5000


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
    starts : ndarray, shape (free state, window), or None
        What is added to the windows' starts, SI units; None where none is estimated.
    far : bool
        Whether a start was too far from where it was looked for: those near by are looked for from
        here.
    """

    loss: float
    count: int
    normal: FloatArray
    descent: FloatArray
    scores: FloatArray
    prior: FloatArray | float = 0.0
    starts: FloatArray | None = None
    far: bool = False

    @property
    def finite(self) -> bool:
        """Whether no rollout diverged."""
        return bool(np.isfinite(self.loss) and np.isfinite(self.normal).all())

    @cached_property
    def inverse(self) -> FloatArray:
        """Pseudo-inverse of the normal matrix, shape (parameter, parameter)."""
        return inverse_normal(self.normal)


def marquardt_scale(normal: FloatArray) -> FloatArray:
    """Return the square roots of the diagonal, shape (parameter,), with a floor against zeros."""
    diagonal = np.diag(normal)
    floor = max(1e-28 * float(diagonal.max()), 1e-300)
    return np.asarray(np.sqrt(np.maximum(diagonal, floor)))


def inverse_normal(normal: FloatArray) -> FloatArray:
    """Return the pseudo-inverse, shape (parameter, parameter), of a scaled normal matrix."""
    scale = marquardt_scale(normal)
    eigenvalues, vectors, kept = _scaled_eigen(normal)
    weights = np.where(kept, 1.0 / np.where(kept, eigenvalues, 1.0), 0.0)
    return np.asarray((vectors * weights) @ vectors.T / np.outer(scale, scale))


def flat_directions(normal: FloatArray) -> FloatArray:
    """Return the directions that the pseudo-inverse leaves out, (parameter, direction), scaled."""
    _, vectors, kept = _scaled_eigen(normal)
    return np.asarray(vectors[:, ~kept])


def _scaled_eigen(normal: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return eigenvalues and vectors of a scaled normal matrix, and which are not flat."""
    scale = marquardt_scale(normal)
    eigenvalues, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    return eigenvalues, vectors, eigenvalues > FLAT * eigenvalues[-1]


def squared(slopes: FloatArray) -> FloatArray:
    """Return S'S (parameter, parameter) of slopes (residual, parameter), many rows of them zero."""
    rows = slopes[slopes.any(axis=1)]
    return np.asarray(rows.T @ rows)


def residual_scale(model: Model, measured: FloatArray, loss: Loss) -> FloatArray:
    """Return what residuals are divided by, shape (quantity,), in the loss's domain.

    Parameters
    ----------
    model : Model
        At its start.
    measured : ndarray, shape (time, state) or (time, output)
        What was recorded of the states, or of the outputs of a model that has them, SI units.
    loss : Loss
        Its `scale`; by default 1 if the states share a unit and else the channels' deviations.
    """
    quantity = measured.T
    if not model.outputs:
        with float64():
            padded = loss.domain(with_batch_axis(model), with_shared_length(measured.T))
            quantity = np.asarray(padded)[:, : len(measured)]
    own = len(dynamic_states(model))
    units = model.outputs.values() or model.state_units[:own]
    found = np.ones(len(quantity))
    if loss.scale is None and len(set(units)) == 1:
        return found
    compared = slice(None) if model.outputs else slice(own)
    scale = loss.scale or channel_deviation
    found[compared] = np.maximum(scale(quantity[compared].T), 1e-300)
    return found
