"""How sure the learned map is at any state: the sandwich, and the spread over the horizons."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.models.base import Model
from penode.models.layout import Layout

_NONE = np.empty((0, 0))
#: Eigenvalue over the largest up to which a direction of parameters has no variance.
_NO_VARIANCE = 1e-14


@dataclass(frozen=True, eq=False)
class LearnedUncertainty:
    """What the deviation of a learned map is computed from.

    Attributes
    ----------
    covariance : ndarray, shape (parameter, parameter)
        HAC sandwich of the raw parameters at the selected horizon, with the variance of Gaussian
        priors in its middle; infinite on the diagonal where the recordings are too short to show
        it.
    agreeing : ndarray, shape (horizon, parameter)
        Raw parameters at the horizons that agree with the selected one, itself included.
    weights : ndarray, shape (horizon,)
        Precision of each of them, summing to 1.
    shifts : mapping of str to ndarray, shape (parameter,)
        What a deviation of each imperfection of the recordings, by the source of its row in the
        budget, moves the raw parameters by; their products are part of the covariance.
    """

    covariance: FloatArray = field(default_factory=lambda: _NONE)
    agreeing: FloatArray = field(default_factory=lambda: _NONE)
    weights: FloatArray = field(default_factory=lambda: np.empty(0))
    shifts: Mapping[str, FloatArray] = field(default_factory=dict)

    def deviation(
        self, model: Model, points: FloatArray, direction: FloatArray | None = None
    ) -> FloatArray:
        """Return the deviation of the learned map, shape (point, output), SI units.

        Its square is the sandwich's variance plus the weighted mean square of what the agreeing
        horizons' maps differ by, as for physical parameters.

        Parameters
        ----------
        model : Model
            The selected one, without batch axis.
        points : ndarray, shape (point, state)
            SI units.
        direction : ndarray, shape (state,), optional
            The deviation is that of the map's slope along it.
        """
        layout: Layout[Model] = Layout(model)
        with float64():
            at, raw = on_device(np.asarray(points, dtype=float).T), on_device(layout.raw(model))
            if not np.isfinite(self.covariance).all() or not self.covariance.size:
                return np.full(_learned_at(model, raw, at).T.shape, np.inf)
            along = None if direction is None else on_device(np.asarray(direction, dtype=float))
            slopes = np.asarray(_slopes(model, raw, at, along))
            agreeing = [_learned_at(model, on_device(raw), at, along) for raw in self.agreeing]
        maps = np.stack([np.asarray(each) for each in agreeing])
        variance = np.einsum("mpi,ij,mpj->pm", slopes, self.covariance, slopes, optimize=True)
        middle = np.tensordot(self.weights, maps, axes=1)
        spread = np.tensordot(self.weights, (maps - middle) ** 2, axes=1).T
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) + spread))

    def joint(self, model: Model, reported: FloatArray) -> FloatArray:
        """Return the covariance of all raw parameters, (parameter, parameter).

        That of the physical parameters is as reported (physical, physical), SI units. All others
        follow them as at the selected horizon, beside what of their own variance does not go with
        them. To it belongs what agreeing horizons differ by where maps are linear in their
        parameters; those of a network at two horizons are not comparable.
        """
        layout: Layout[Model] = Layout(model)
        known = np.isfinite(reported).all() and np.isfinite(self.covariance).all()
        if not known or len(reported) != layout.physical_members.sum():
            return np.full((layout.size, layout.size), np.inf)
        covariance, ours = self.covariance, layout.physical_members
        if layout.linear_members[~ours].all():
            gap = self.agreeing - self.weights @ self.agreeing
            covariance = covariance + (self.weights * gap.T) @ gap
        slopes = physical_slopes(model)
        inverse = np.linalg.inv(slopes[:, ours])
        within = covariance[np.ix_(ours, ours)]
        follow = covariance[:, ours] @ np.linalg.pinv(within, rcond=_NO_VARIANCE, hermitian=True)
        follow[ours] = np.eye(ours.sum())
        change = inverse @ reported @ inverse.T - within
        return np.asarray(covariance + follow @ change @ follow.T)


def physical_slopes(model: Model) -> FloatArray:
    """Return d(physical)/d(raw) of a model without batch axis, (physical, parameter)."""
    layout: Layout[Model] = Layout(model)
    with float64():
        return np.asarray(_physical_slopes(model, on_device(layout.raw(model))))


def map_slopes(model: Model, points: FloatArray) -> FloatArray:
    """Return d(map)/d(raw) at points (point, state), (point, output, parameter)."""
    layout: Layout[Model] = Layout(model)
    with float64():
        at = on_device(np.asarray(points, dtype=float).T)
        slopes = np.asarray(_slopes(model, on_device(layout.raw(model)), at))
    return np.moveaxis(slopes, 1, 0)


@jax.jit
def _physical_slopes(like: Model, raw: JaxArray) -> JaxArray:
    """Return d(physical)/d(raw), (physical, parameter); of `like` only the structure counts."""
    layout: Layout[Model] = Layout(like)
    slopes: JaxArray = jax.jacfwd(lambda raw: layout.physical_values(layout.values(raw)))(raw)
    return slopes


@jax.jit
def _learned_at(
    like: Model, raw: JaxArray, at: JaxArray, along: JaxArray | None = None
) -> JaxArray:
    """Return the map (output, point) of a raw vector; of `like` only the structure counts.

    With a direction (state,) its slope along that.
    """
    layout: Layout[Model] = Layout(like)
    learned = layout.model(layout.values(raw)[:, None]).learned
    if along is None:
        return learned(at)
    slope: JaxArray = jax.jvp(learned, (at,), (jnp.broadcast_to(along[:, None], at.shape),))[1]
    return slope


_slopes = jax.jit(jax.jacfwd(_learned_at, argnums=1))
