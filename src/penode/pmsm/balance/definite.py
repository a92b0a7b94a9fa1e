"""Positive definite inductance where nothing was recorded: observations of what is known there.

Smoothing continues a map towards the linear machine, but a strongly saturated one may bend so much
at the edge of the recordings that the differential inductance leaves the physical range beyond. In
the rectangle that holds the recorded currents, where tables are made, it is held, and so far beyond
as a free run may overshoot them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.models.base import Model
from penode.models.layout import Layout
from penode.pmsm.balance.smoothing import Roughness, Smoothed, penalised
from penode.pmsm.machine.coenergy_map import HESSIAN, CoenergyPart, columns, quadratic
from penode.training.weak_form import WeakRegression

#: Points a side of the rectangle, and recorded ones that say how small an inductance may be.
_GRID, _POINTS = 31, 200
#: Least inductance beyond the recordings over the least within; what is below half of it is raised.
_LEAST = 0.2
#: That least inductance over the deviation with which it is known: surer than a misfit of training.
_CERTAIN = 40.0
#: Most rounds in which points are added.
_ROUNDS = 15


@dataclass(frozen=True, eq=False)
class Held:
    """A map whose inductance is positive definite over the rectangle of the recordings."""

    solution: FloatArray
    # W_dd, W_dq, W_qq of each coefficient of the mean map there, (point, 3, coefficient).
    hessians: FloatArray = field(repr=False)
    # Inductances in one direction over their deviation, (observation, coefficient).
    rows: FloatArray
    # Their values (observation,).
    target: FloatArray
    # Smallest that training may reach, in any direction; 0 where nothing says how large one is.
    least: float = 0.0


def held_definite(
    equations: WeakRegression,
    penalties: Sequence[Roughness],
    smoothed: Smoothed,
    parts: Sequence[CoenergyPart],
    currents: FloatArray,
    beyond: float = 0.0,
) -> Held:
    """Add observations of a small positive inductance where a solution has less.

    The coefficients of `parts`, of the mean map, are the last of the solution; `currents`
    (time, 2) are dimensionless. The rectangle is larger by a share `beyond` of what holds them.
    """
    first = len(smoothed.solution) - sum(part.coefficients.size for part in parts)
    everywhere = hessians(parts, _rectangle(currents, beyond))
    solution = smoothed.solution
    rows, target = np.zeros((0, len(solution))), np.zeros(0)
    without = ~currents.any(axis=0)  # axes whose inductance nothing shows
    known = _visited(parts, currents, solution[first:])
    if not known:  # nothing says how large an inductance is
        return Held(solution, everywhere, rows, target)
    floor, unseen = _LEAST * known, np.zeros_like(solution)
    if without.any():  # neither data nor roughness see it; rounding alone would decide
        size = parts[0].coefficients.size
        unseen[first : first + size] = quadratic(parts[0], np.asarray(known * without))
    solution = solution + unseen
    for _ in range(_ROUNDS):
        values, directions = _principal(everywhere, solution[first:])
        bad = values[:, 0] < floor / 2
        if not bad.any():
            break
        d, q = directions[bad, :, 0].T
        along = np.stack([d * d, 2 * d * q, q * q], axis=1)
        new = np.zeros((int(bad.sum()), len(solution)))
        new[:, first:] = np.einsum("pk,pkc->pc", along, everywhere[bad])
        rows = np.concatenate([rows, new / (floor / _CERTAIN)])
        target = np.concatenate([target, np.full(len(new), _CERTAIN)])
        left = target - rows @ unseen
        solution = penalised(equations, penalties, smoothed, (rows, left)) + unseen
    # A little below, so that rounding lets no penalty begin where training does.
    reached = (1 - 1e-5) * least_inductance(everywhere, solution[first:])
    least = min(floor / 2, reached) if reached > 0 else floor / 2
    return Held(solution, everywhere, rows, target, least)


def is_definite(
    parts: Sequence[CoenergyPart], currents: FloatArray, beyond: float, coefficients: FloatArray
) -> bool:
    """Return whether a mean map needs no such observations."""
    least = least_inductance(hessians(parts, _rectangle(currents, beyond)), coefficients)
    floor = _LEAST * _visited(parts, currents, coefficients)
    return 0 < floor / 2 <= least


def _visited(
    parts: Sequence[CoenergyPart], currents: FloatArray, coefficients: FloatArray
) -> float:
    """Return the least principal inductance where currents have been; 0 for none."""
    points = hessians(parts, currents[:: max(len(currents) // _POINTS, 1)])
    without = ~currents.any(axis=0)
    return _known(_principal(points, coefficients)[0][:, without.sum() :])


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("hessians", "least", "weight"),
    meta_fields=(),
)
@dataclass(frozen=True, eq=False)
class PositiveInductance:
    """A penalty on inductances below a least one (dimensionless, as W), in any direction."""

    # W_dd, W_dq, W_qq of each coefficient of the mean map, the first of the learned ones.
    hessians: FloatArray = field(repr=False)
    least: float
    # What a point without any inductance adds to the loss, in its units.
    weight: float

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return what each point lacks."""
        chosen = np.flatnonzero(layout.value_members(("learned",)))[: self.hessians.shape[2]]
        lacking = _lacking(jnp.asarray(self.hessians), jnp.asarray(self.least), values[chosen])
        return lacking * (jnp.sqrt(self.weight) / self.least)


@jax.custom_jvp
def _lacking(hessians: JaxArray, least: JaxArray, coefficients: JaxArray) -> JaxArray:
    """Return by how much the smallest inductance at each point is below the least."""
    return _lacking_along(hessians, least, coefficients)[0]


@_lacking.defjvp
def _(primals: tuple[JaxArray, ...], tangents: tuple[JaxArray, ...]) -> tuple[JaxArray, JaxArray]:
    """Contract Hessians with the directions of least inductance once, not for every tangent."""
    lacking, along = _lacking_along(*primals)
    slopes = -jnp.einsum("kp,pkc->pc", along, primals[0])
    return lacking, slopes @ tangents[2]


def _lacking_along(
    hessians: JaxArray, least: JaxArray, coefficients: JaxArray
) -> tuple[JaxArray, JaxArray]:
    """Return what is lacking (point,) and minus its slope by W_dd, W_dq and W_qq (3, point)."""
    a, b, c = (hessians @ coefficients).T
    half = jnp.sqrt(((a - c) / 2) ** 2 + b**2 + (1e-6 * least) ** 2)
    lacking = jnp.maximum(least - ((a + c) / 2 - half), 0.0)
    share = (a - c) / (4 * half)
    return lacking, (lacking > 0) * jnp.stack([0.5 - share, -b / half, 0.5 + share])


def held_in_training(held: Held, weight: float) -> tuple[PositiveInductance, ...]:
    """Return the penalty that keeps a map definite where it was held."""
    return (PositiveInductance(held.hessians, held.least, weight),) if held.least > 0 else ()


def _rectangle(currents: FloatArray, beyond: float) -> FloatArray:
    """Return points (point, 2) on an even grid over a rectangle that holds currents."""
    low, high = currents.min(axis=0), currents.max(axis=0)
    further = beyond / 2 * (high - low)
    axes = [np.linspace(*ends, _GRID) for ends in zip(low - further, high + further, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def hessians(parts: Sequence[CoenergyPart], points: FloatArray) -> FloatArray:
    """Return W_dd, W_dq and W_qq of each coefficient, shape (point, 3, coefficient)."""
    return np.concatenate([columns(part, points, HESSIAN) for part in parts], axis=2)


def _known(inductances: FloatArray) -> float:
    """Return the least principal inductance (point, axis) that the recordings show; 0 for none.

    With hardly any current in one axis all smaller ones may be nothing but noise.
    """
    for least in inductances.T:
        positive = least[least > 0]
        if len(positive):
            return float(positive.min() if len(positive) == len(least) else np.median(positive))
    return 0.0


def least_inductance(hessians: FloatArray, weights: FloatArray) -> float:
    """Return the least principal inductance of coefficients (coefficient,)."""
    return float(_principal(hessians, weights)[0].min())


def _principal(hessians: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return principal inductances (point, 2), in order, and their directions (point, 2, 2)."""
    a, b, c = (hessians @ weights).T
    matrices = np.stack([np.stack([a, b], axis=-1), np.stack([b, c], axis=-1)], axis=-1)
    values, vectors = np.linalg.eigh(matrices)
    return values, vectors
