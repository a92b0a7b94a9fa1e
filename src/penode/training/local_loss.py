"""The loss about a point: quadratic in what the data add to it, with its penalties as they are."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.training.gauss_newton_terms import GaussNewtonTerms, marquardt_scale, squared
from penode.training.plan import Problem

#: Most rounds in which a step is adapted to the penalties, and most halvings in each: where a limit
#: is touched a fraction of 1e-8 may be all that stays inside, and no step at all ends a training.
_ROUNDS, _HALVINGS = 30, 40
#: Of the decrease so far: a round that promises less is not worth its while.
_LITTLE = 1e-4

#: Residuals of penalties (residual,) and their slopes (residual, moving).
_Penalties: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class LocalLoss:
    """What Gauss and Newton know of the data at a point, beside the penalties everywhere.

    Rollouts are dear and penalties are cheap. A penalty that begins at a limit is another beyond
    it, and a step that sees only its slopes on this side goes far across, or to and fro.
    """

    problem: Problem
    raw: FloatArray
    terms: GaussNewtonTerms

    def step(self, damping: float) -> FloatArray:
        """Return the step (moving,), damped relative to the normal matrix's scaled diagonal."""
        scale = marquardt_scale(self.terms.normal)
        held = damping * scale**2
        step, decrease, here = np.zeros(len(scale)), 0.0, self._penalties
        for _ in range(_ROUNDS):
            normal, descent = self._at(step, here)
            damped = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
            descent = descent - held * step
            further = np.linalg.solve(damped, descent / scale) / scale
            if descent @ further <= _LITTLE * decrease:
                break
            if not len(self._penalties[0]):
                return np.asarray(further)
            for fraction in 0.5 ** np.arange(_HALVINGS):
                candidate = step + fraction * further
                there = self._after(candidate)
                lower = self._decrease(candidate, held, there[0])
                if lower > decrease:
                    step, decrease, here = candidate, lower, there
                    break
            else:
                break
        return step

    def promised(self, step: FloatArray) -> float:
        """Return the decrease of the loss by a step (moving,)."""
        return self._decrease(step, 0.0, self._after(step)[0]) / self.terms.count

    @cached_property
    def _penalties(self) -> _Penalties:
        return self.problem.penalties(self.raw)

    def _after(self, step: FloatArray) -> _Penalties:
        if not len(self._penalties[0]):
            return self._penalties
        return self.problem.penalties(self.raw + self.problem.spread(step))

    def _at(self, step: FloatArray, here: _Penalties) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrix and the descent after a step, where penalties are as given."""
        terms = self.terms
        if not step.any():
            return terms.normal, terms.descent
        (before, old), (after, new) = self._penalties, here
        data = terms.normal - terms.count * squared(old)
        descent = terms.descent + terms.count * (old.T @ before - new.T @ after)
        return data + terms.count * squared(new), descent - data @ step

    def _decrease(self, step: FloatArray, held: FloatArray | float, after: FloatArray) -> float:
        """Return the decrease of the damped sum of squares, penalties given after the step."""
        terms = self.terms
        quadratic = step @ (2 * terms.descent - terms.normal @ step - held * step)
        before, old = self._penalties
        straight = before + old @ step
        return float(quadratic + terms.count * (straight @ straight - after @ after))
