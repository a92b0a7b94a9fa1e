"""The loss about a point: quadratic in what the data add to it, with its penalties as they are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from penode.arrays import FloatArray
from penode.training.gauss_newton_terms import GaussNewtonTerms, marquardt_scale
from penode.training.plan import Problem

#: Most rounds in which a step is adapted to the penalties, and most halvings in each.
_ROUNDS, _HALVINGS = 30, 12
#: Of the decrease so far: a round that promises less is not worth its while.
_LITTLE = 1e-4


@dataclass(frozen=True, eq=False)
class LocalLoss:
    """What Gauss and Newton know of the data at a point, beside the penalties everywhere.

    Rollouts are dear and penalties are cheap. A penalty that begins at a limit is another beyond
    it, and a step that sees only its slopes on this side goes far across, or to and fro.

    Attributes
    ----------
    problem : Problem
    raw : ndarray, shape (parameter,)
        The point.
    terms : GaussNewtonTerms
        Of the moving parameters there.
    """

    problem: Problem
    raw: FloatArray
    terms: GaussNewtonTerms

    def step(self, damping: float) -> FloatArray:
        """Return the damped step of the moving parameters, shape (moving,).

        Parameters
        ----------
        damping : float
            Relative to the scaled diagonal of the normal matrix.
        """
        scale = marquardt_scale(self.terms.normal)
        step, decrease = np.zeros(len(scale)), 0.0
        for _ in range(_ROUNDS):
            normal, descent = self._at(step)
            damped = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
            descent = descent - damping * scale**2 * step
            further = np.linalg.solve(damped, descent / scale) / scale
            if descent @ further <= _LITTLE * decrease:
                break
            if not len(self._penalties[0]):
                return np.asarray(further)
            step, reached = self._shortened(step, further, damping * scale**2)
            if reached <= decrease:
                break
            decrease = reached
        return step

    def promised(self, step: FloatArray) -> float:
        """Return the decrease of the loss by a step (moving,)."""
        return self._decrease(step, 0.0) / self.terms.count

    @cached_property
    def _penalties(self) -> tuple[FloatArray, FloatArray]:
        return self.problem.penalties(self.raw)

    def _at(self, step: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrix and the descent after a step."""
        terms = self.terms
        if not step.any():
            return terms.normal, terms.descent
        (before, old), (after, new) = self._penalties, self._after(step)
        data = terms.normal - terms.count * old.T @ old
        descent = terms.descent + terms.count * (old.T @ before - new.T @ after)
        return data + terms.count * new.T @ new, descent - data @ step

    def _after(self, step: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.problem.penalties(self.raw + self.problem.spread(step))

    def _shortened(
        self, step: FloatArray, further: FloatArray, held: FloatArray
    ) -> tuple[FloatArray, float]:
        """Return a step with as much of `further` as lowers the damped loss, and by how much."""
        here = self._decrease(step, held)
        for fraction in 0.5 ** np.arange(_HALVINGS):
            candidate = step + fraction * further
            decrease = self._decrease(candidate, held)
            if decrease > here:
                return candidate, decrease
        return step, here

    def _decrease(self, step: FloatArray, held: FloatArray | float) -> float:
        """Return the decrease of the damped sum of squares by a step."""
        terms = self.terms
        quadratic = step @ (2 * terms.descent - terms.normal @ step - held * step)
        before, old = self._penalties
        if not len(before):
            return float(quadratic)
        after = self._after(step)[0]
        straight = before + old @ step
        return float(quadratic + terms.count * (straight @ straight - after @ after))
