"""Penalties: what is known beside the data, as small objects that return residuals of their own."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.models.base import Model
from penode.models.layout import Layout


class Penalty(Protocol):
    """Residuals that do not come from data; the sum of their squares is added to the loss.

    Numbers of one that is a pytree are arguments of compiled code; any other is compiled anew.
    """

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the residuals.

        Parameters
        ----------
        layout : Layout
            Of the model.
        values : array, shape (value,)
            All its parameters.

        Returns
        -------
        array, shape (residual,)
        """
        ...


@dataclass(frozen=True)
class WeightDecay:
    """Shrinks a group of parameters towards zero.

    Attributes
    ----------
    weight : float
        Of the mean square of the group's values, in units of the loss.
    group : str
        Learned parameters by default.
    """

    weight: float
    group: str = "learned"

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the group's values, scaled."""
        chosen = np.flatnonzero(layout.value_members((self.group,)))
        return values[chosen] * math.sqrt(self.weight / max(len(chosen), 1))


@dataclass(frozen=True)
class Priors:
    """The priors declared with the parameters, as strong as independent residuals would make them.

    Without it in the loss `penode.identify` estimates that strength, and the priors act all the
    same.

    Attributes
    ----------
    noise : float
        Deviation of one independent residual, in units of the residual scale.
    count : int
        Number of independent residuals behind the data's loss.
    """

    noise: float
    count: int

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the standardised distances from the priors, scaled."""
        return layout.beliefs(values) * (self.noise / math.sqrt(self.count))


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("factor", "variance", "mean"),
    meta_fields=("group",),
)
@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """A Gaussian belief about linear combinations of the learned parameters.

    What the data do not determine then varies as the belief says: its variance joins that of the
    data in the covariance of the estimate (Wahba, J. R. Stat. Soc. B 45 (1983) 133,
    doi:10.1111/j.2517-6161.1983.tb01239.x), so a band grows where nothing was recorded.

    Attributes
    ----------
    factor : ndarray, shape (combination, value of the group)
        Each combination of the group's values is zero but for the belief's deviation. It is scaled
        so that its squares add to the loss.
    variance : ndarray, shape (combination,)
        Variance of each scaled combination.
    mean : ndarray, shape (combination,), or 0
        What each scaled combination is believed to be.
    group : str
        Learned parameters by default.
    """

    factor: FloatArray = field(repr=False)
    variance: FloatArray = field(repr=False)
    mean: FloatArray | float = field(default=0.0, repr=False)
    group: str = "learned"

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the scaled combinations."""
        chosen = np.flatnonzero(layout.value_members((self.group,)))
        return jnp.asarray(self.factor) @ values[chosen] - self.mean

    def slopes(self, layout: Layout[Model]) -> FloatArray:
        """Return the derivative of the combinations by all values, (combination, value)."""
        members = layout.value_members((self.group,))
        slopes = np.zeros((len(self.factor), len(members)))
        slopes[:, members] = self.factor
        return slopes


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Shrinks the learned map towards a straight one, by its second differences along each state.

    Attributes
    ----------
    points : ndarray, shape (point, state)
        Where, SI units.
    step : ndarray, shape (state,)
        Length of the differences in SI units; 0 leaves a state out.
    weight : float
        Of the mean squared second difference, in units of the loss.
    """

    points: FloatArray
    step: FloatArray
    weight: float

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the second differences, scaled."""
        learned = layout.model(values[:, None]).learned
        x = jnp.asarray(self.points.T)
        shifts = [s * e[:, None] for s, e in zip(self.step, np.eye(len(x)), strict=True) if s]
        bends = [learned(x + d) - 2 * learned(x) + learned(x - d) for d in shifts]
        return _mean_square(jnp.stack(bends), self.weight)


@dataclass(frozen=True, eq=False)
class SoftReciprocity:
    """Shrinks the learned map's Jacobian towards a symmetric one: a map from an energy.

    Attributes
    ----------
    points : ndarray, shape (point, state)
        Where, SI units. The learned map must have as many outputs as there are states.
    weight : float
        Of the mean squared skew part, in units of the loss.
    """

    points: FloatArray
    weight: float

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the skew parts, scaled."""
        learned = layout.model(values[:, None]).learned
        x = jnp.asarray(self.points.T)
        columns = [_along(learned, x, direction) for direction in np.eye(len(x))]
        jacobian = jnp.stack(columns, axis=1)
        rows, others = np.triu_indices(len(x), 1)
        return _mean_square((jacobian[rows, others] - jacobian[others, rows]) / 2, self.weight)


@dataclass(frozen=True, eq=False)
class Orthogonality:
    """Keeps the learned map from doing the work of the physical terms.

    Attributes
    ----------
    points : ndarray, shape (point, state)
        Visited states, SI units.
    regressors : callable
        ``regressors(x)``: what multiplies each physical parameter, shape (regressor, output,
        point), in the learned map's unit per unit of the parameter.
    weight : float
        Of the learned map's squared share along each regressor, in units of the loss.
    """

    points: FloatArray
    regressors: Callable[[JaxArray], JaxArray]
    weight: float

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the learned map's components along the regressors, scaled."""
        x = jnp.asarray(self.points.T)
        learned = layout.model(values[:, None]).learned(x).ravel()
        regressors = self.regressors(x).reshape(-1, len(learned))
        along, _ = jnp.linalg.qr(regressors.T)
        return along.T @ learned * math.sqrt(self.weight / len(learned))


def _along(learned: Callable[[JaxArray], JaxArray], x: JaxArray, direction: FloatArray) -> JaxArray:
    tangent = jnp.broadcast_to(jnp.asarray(direction)[:, None], x.shape)
    slope: JaxArray = jax.jvp(learned, (x,), (tangent,))[1]
    return slope


def _mean_square(residuals: JaxArray, weight: float) -> JaxArray:
    return residuals.ravel() * math.sqrt(weight / residuals.size)
