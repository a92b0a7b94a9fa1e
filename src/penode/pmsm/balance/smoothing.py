"""Smoothing by marginal likelihood: how far roughness is held down is estimated, not set.

Equations A c = y with a penalty sum_k lambda_k c' S_k c. The penalty is a Gaussian prior whose
precision is lambda_k S_k over the variance of an equation; its strengths maximise the restricted
likelihood (REML). S. N. Wood, J. R. Stat. Soc. B 73 (2011) 3, doi:10.1111/j.1467-9868.2010.00749.x.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from penode.arrays import FloatArray
from penode.training.gauss_newton_terms import inverse_normal
from penode.training.weak_form import OVERLAP, WeakRegression

#: Decades within which a strength is sought, over that at which penalty and data weigh the same.
_LOWEST, _HIGHEST, _FIRST = -7.0, 3.0, -3.0
#: Decades between the strengths that are tried, so that the last digits of a recording do not move
#: the answer; and steps of the search, in these.
_ROUNDED, _STEPS = 0.25, (6, 3, 2, 1)
#: Decades by which strengths are raised at a time where the solution is no possible one.
_RAISED = 0.5
#: Keeps directions that neither data nor penalty see, such as a coenergy's constant.
_RIDGE = 1e-13


@dataclass(frozen=True, eq=False)
class Roughness:
    """A quadratic penalty on consecutive coefficients from `first` on."""

    first: int
    # S (coefficient, coefficient), positive semidefinite.
    matrix: FloatArray
    rank: int
    # Log of the product of its eigenvalues that are not zero.
    volume: float

    @classmethod
    def of(cls, first: int, matrix: FloatArray) -> "Roughness":
        """Return the penalty with rank and volume of its matrix."""
        eigenvalues = np.linalg.eigvalsh(matrix)
        kept = eigenvalues[eigenvalues > len(matrix) * np.finfo(float).eps * eigenvalues[-1]]
        return cls(first, matrix, len(kept), float(np.sum(np.log(kept))))

    @property
    def place(self) -> slice:
        """Where its coefficients are."""
        return slice(self.first, self.first + len(self.matrix))


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Penalised least squares at the strengths that the data favour.

    What is not penalised is believed to be about as large before as one equation shows (unit
    information; Kass and Wasserman 1995, doi:10.1080/01621459.1995.10476592), whatever its
    unit.
    """

    solution: FloatArray
    # lambda of each penalty.
    strength: FloatArray
    # Variance of an equation that counts as one, of several that overlap.
    noise: float
    # Of a coefficient along the eigenvectors of S, over its eigenvalue; one a penalty.
    prior_variance: FloatArray
    # -2 log of the evidence: smaller is better. Restricted likelihoods of models with more and with
    # fewer coefficients that are free differ by the unit of the target; this does not.
    evidence: float


def smoothed(equations: WeakRegression, penalties: Sequence[Roughness]) -> Smoothed:
    """Solve equations with penalties whose strengths maximise the restricted likelihood.

    The equations are in the order of their windows, which overlap by three quarters.
    """
    problem = _Normal.of(equations, penalties)
    logs = _ROUNDED * lowest(
        lambda place: problem.evidence(_ROUNDED * place)[0],
        np.full(len(penalties), round(_FIRST / _ROUNDED)),
        (round(_LOWEST / _ROUNDED), round(_HIGHEST / _ROUNDED)),
    )
    return problem.smoothed(logs)


def stiffened(
    equations: WeakRegression,
    penalties: Sequence[Roughness],
    found: Smoothed,
    possible: Callable[[FloatArray], bool],
) -> Smoothed | None:
    """Raise all strengths alike until the solution is a possible one; None where none is."""
    problem = _Normal.of(equations, penalties)
    logs = np.log10(found.strength / problem.balance)
    while logs.max() < _HIGHEST:
        logs = logs + _RAISED
        stiffer = problem.smoothed(logs)
        if possible(stiffer.solution):
            return stiffer
    return None


def penalised(
    equations: WeakRegression,
    penalties: Sequence[Roughness],
    smoothed: Smoothed,
    observed: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Solve once more at strengths found before, with further observations.

    `observed` are rows (observation, coefficient) and values (observation,) of deviation 1.
    """
    matrix, target = equations.matrix, equations.target
    rows, values = observed
    normal = matrix.T @ matrix + smoothed.noise * rows.T @ rows
    right = matrix.T @ target + smoothed.noise * rows.T @ values
    return _solved(_with_penalties(normal, penalties, smoothed.strength), right)[0]


def deviations(
    equations: WeakRegression, penalties: Sequence[Roughness], smoothed: Smoothed
) -> FloatArray:
    """Return the deviation of each coefficient (coefficient,) at strengths found before."""
    normal = equations.matrix.T @ equations.matrix
    inverse = inverse_normal(_with_penalties(normal, penalties, smoothed.strength))
    return np.asarray(np.sqrt(smoothed.noise * np.maximum(np.diag(inverse), 0.0)))


def _with_penalties(
    normal: FloatArray, penalties: Sequence[Roughness], strengths: FloatArray
) -> FloatArray:
    """Return the normal matrix with the penalties' own added."""
    whole = normal.copy()
    for penalty, strength in zip(penalties, strengths, strict=True):
        whole[penalty.place, penalty.place] += strength * penalty.matrix
    return whole


def _solved(normal: FloatArray, right: FloatArray) -> tuple[FloatArray, float]:
    """Return the solution of a positive definite system, and the log determinant."""
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size)
    scaled[np.diag_indices_from(scaled)] += _RIDGE
    factor: Any = cho_factor(scaled, lower=True, check_finite=False)
    solution = cho_solve(factor, right / size, check_finite=False) / size
    volume = 2 * float(np.sum(np.log(np.diag(factor[0]))) + np.sum(np.log(size)))
    return np.asarray(solution), volume


def lowest(
    function: Callable[[FloatArray], float], first: FloatArray, limits: tuple[int, int]
) -> FloatArray:
    """Return the whole numbers (axis,) at which a function is lowest, by a compass search.

    Steps along one axis at a time, first long, then half as long, to one; where none leads
    lower, the place is lower than its neighbours (Hooke and Jeeves 1961,
    doi:10.1145/321062.321069). No place is evaluated twice.
    """
    evaluated: dict[tuple[float, ...], float] = {}

    def value(place: FloatArray) -> float:
        key = tuple(place)
        if key not in evaluated:
            evaluated[key] = function(place)
        return evaluated[key]

    best = np.asarray(first, dtype=np.float64)
    ways = [sign * way for way in np.eye(len(best)) for sign in (1.0, -1.0)]
    for length in _STEPS:
        moved = True
        while moved:
            trials = [np.clip(best + length * way, *limits) for way in ways]
            better = min(trials, key=value, default=best)
            moved = value(better) < value(best)
            best = better if moved else best
    return best


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations with scaled columns."""

    normal: FloatArray
    right: FloatArray
    energy: float
    count: float
    penalties: Sequence[Roughness]
    balance: FloatArray
    unpenalised: float

    @classmethod
    def of(cls, equations: WeakRegression, penalties: Sequence[Roughness]) -> "_Normal":
        matrix, target = equations.matrix, equations.target
        normal = matrix.T @ matrix
        free, count = np.ones(len(normal), bool), len(target) / OVERLAP
        for penalty in penalties:
            free[penalty.place] = False
        information = np.maximum(np.diag(normal)[free] / max(count, 1.0), 1e-300)
        even = [np.trace(normal[p.place, p.place]) / np.trace(p.matrix) for p in penalties]
        return cls(
            normal=normal,
            right=matrix.T @ target,
            energy=float(target @ target),
            count=count,
            penalties=penalties,
            balance=np.maximum(even, 1e-300),
            unpenalised=float(np.sum(np.log(information))),
        )

    @property
    def coefficients(self) -> int:
        """Number of those that are free."""
        return len(self.right) - sum(penalty.rank for penalty in self.penalties)

    def smoothed(self, logs: FloatArray) -> Smoothed:
        """Return the solution at log10 strengths."""
        evidence, solution, variance = self.evidence(logs)
        strength = self.balance * 10.0**logs
        evidence += self.coefficients * float(np.log(variance / OVERLAP))
        return Smoothed(solution, strength, variance, variance / strength, evidence)

    def evidence(self, logs: FloatArray) -> tuple[float, FloatArray, float]:
        """Return -2 log REML, the solution and the variance of an equation at log10 strengths."""
        whole = _with_penalties(self.normal, self.penalties, self.balance * 10.0**logs)
        solution, volume = _solved(whole, self.right)
        left = max(self.energy - float(self.right @ solution), 1e-14 * self.energy) / OVERLAP
        free = max(self.count - self.coefficients, 1.0)
        strengths = np.log(self.balance) + np.log(10.0) * logs
        volume -= self.unpenalised
        prior = sum(p.rank * s + p.volume for p, s in zip(self.penalties, strengths, strict=True))
        return free * np.log(left / free) + volume - float(prior), solution, OVERLAP * left / free
