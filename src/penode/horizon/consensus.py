"""Consensus: what the horizons of a plateau say together.

Windows of another horizon start from other measured samples, and leave other errors behind. So the
horizons of a plateau err in part independently of each other, and their mean is surer than any.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.horizon.ladder import RungFit
from penode.horizon.selection import weighted_deviation
from penode.models.base import Model
from penode.models.layout import Layout
from penode.training.covariance import inverse_normal

#: Weight of rungs that know their deviations from which on the mean's is given.
_MOST = 0.5

#: Deviations are cut here, SI units, so that no weight is zero over zero.
_UNSURE = 1e100


@dataclass(frozen=True, eq=False)
class Consensus:
    """Physical parameters as rungs give them together.

    Attributes
    ----------
    values, deviation : ndarray, shape (physical,)
        Means weighted by precision, and their deviations, SI units. A deviation is infinite where
        most of the weight is on rungs that do not know their own.
    """

    values: FloatArray
    deviation: FloatArray

    @classmethod
    def of(cls, rungs: Sequence[RungFit]) -> "Consensus":
        """Return what agreeing rungs say together.

        The variance is that of the weighted influences, in which what horizons share counts as
        shared and what is their own averages out, and the square of the spread: influences do not
        show a bias, and what pulls horizons apart pulls their mean.
        """
        values, weights = _weighed(rungs)
        middle, spread = _middle(values, weights)
        deviation = np.hypot(weighted_deviation(rungs, weights), spread)
        known = np.isfinite([rung.deviation[: values.shape[1]] for rung in rungs])
        sure = np.sum(weights * known, axis=0) >= _MOST
        return cls(middle, np.where(sure, deviation, np.inf))

    @classmethod
    def around(cls, chosen: RungFit, rungs: Sequence[RungFit]) -> "Consensus":
        """Return what one rung says, less sure by the spread of those it is chosen from."""
        values, weights = _weighed(rungs)
        _, spread = _middle(values, weights)
        physical = values.shape[1]
        return cls(chosen.values[:physical], np.hypot(chosen.deviation[:physical], spread))


def _weighed(rungs: Sequence[RungFit]) -> tuple[FloatArray, FloatArray]:
    """Return the physical parameters of rungs and their precisions, both (rung, physical)."""
    physical = len(rungs[0].influence)
    values = np.stack([rung.values[:physical] for rung in rungs])
    precision = np.clip([rung.working[:physical] for rung in rungs], 1e-100, _UNSURE) ** -2.0
    return values, precision / precision.sum(axis=0)


def _middle(values: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted means and deviations, both (physical,), of values (rung, physical)."""
    middle = np.sum(weights * values, axis=0)
    return middle, np.sqrt(np.sum(weights * (values - middle) ** 2, axis=0))


def settled(
    layout: Layout[Model], rung: RungFit, moving: BoolArray, values: FloatArray
) -> FloatArray:
    """Return raw parameters (parameter,): physical ones as given, the others where loss is least.

    Parameters
    ----------
    layout : Layout
        Of the rung's model.
    rung : RungFit
        At a minimum; its Gauss-Newton terms tell how the others follow.
    moving : ndarray of bool, shape (parameter,)
        Raw parameters that the terms are of.
    values : ndarray, shape (physical,)
        Physical parameters near the rung's, SI units.
    """
    raw, normal = rung.solution.raw, rung.solution.terms.normal
    found = layout.with_physical(raw, values)
    given = layout.physical_members[moving]
    if not given.all():
        force = normal[np.ix_(~given, given)] @ (found - raw)[moving][given]
        follow = np.flatnonzero(moving)[~given]
        found[follow] -= inverse_normal(normal[np.ix_(~given, ~given)]) @ force
    return found
