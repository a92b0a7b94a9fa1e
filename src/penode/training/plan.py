"""Plan: ordered stages of training, and the problem each one hands to its optimiser."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.windows import DEFAULT_PLACEMENT, Placement, Windows
from penode.errors import InputError
from penode.predictors.base import DEFAULT_HOLD, DEFAULT_SOLVER
from penode.predictors.holds import Hold
from penode.predictors.solver import Solver
from penode.training.covariance import Reported
from penode.training.gauss_newton_terms import GaussNewtonTerms
from penode.training.loss import DEFAULT_LOSS, Loss
from penode.training.residuals import Objective

#: Receives the raw parameters (parameter,) and the loss as an optimiser goes.
Progress = Callable[[FloatArray, float], None]

#: Squared sensitivities below this fraction of the largest are taken for rounding noise.
_ROUNDING = 1e-15

DIVERGED = "The rollouts diverge."
CONVERGED = "Reported quantities have converged."


def ignore_progress(raw: FloatArray, loss: float) -> None:
    """Report nothing."""


@dataclass(frozen=True, eq=False)
class Problem:
    """One stage made concrete: an objective over windows, with some parameters held.

    Attributes
    ----------
    objective : Objective
    reported : Reported
        Quantities by which convergence is judged.
    windows : Windows
    moving : ndarray of bool, shape (parameter,)
        Raw parameters that move; all others stay.
    """

    objective: Objective
    reported: Reported
    windows: Windows
    moving: BoolArray

    def gauss_newton(
        self, raw: FloatArray, near: GaussNewtonTerms | None = None
    ) -> GaussNewtonTerms:
        """Return the terms of the moving parameters at raw (parameter,).

        Where one step does not lead to the windows' starts they are looked for from those of the
        least loss known, or from those of `near`.
        """
        key = raw.tobytes()
        if key not in self._known:
            terms = self._gauss_newton(raw, near)
            while len(self._known) > 1:
                self._known.pop(next(iter(self._known)))
            self._known[key] = terms
        return self._known[key]

    @cached_property
    def _known(self) -> dict[bytes, GaussNewtonTerms]:
        """The last terms by raw parameters: where training begins is often known already."""
        return {}

    def _gauss_newton(self, raw: FloatArray, near: GaussNewtonTerms | None) -> GaussNewtonTerms:
        near = min(self._known.values(), key=lambda terms: terms.loss, default=near)
        starts = near.starts if near is not None and near.far and near.finite else None
        terms = self.objective.gauss_newton(raw, self.windows, starts)
        normal = (terms.normal + self._ridge(terms.normal))[np.ix_(self.moving, self.moving)]
        scores = terms.scores[self.moving]
        prior = terms.prior
        if isinstance(prior, np.ndarray):
            prior = prior[np.ix_(self.moving, self.moving)]
        descent = terms.descent[self.moving]
        moved = (terms.loss, terms.count, normal, descent, scores, prior, terms.starts, terms.far)
        return GaussNewtonTerms(*moved)

    def penalties(self, raw: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the penalties' residuals at raw (parameter,) and slopes (residual, moving)."""
        residuals, slopes = self.objective.penalties(raw)
        return residuals, slopes[:, self.moving]

    def _ridge(self, normal: FloatArray) -> FloatArray:
        """Return what keeps a learned parameter that nothing depends on from drifting away.

        Its column is rounding noise, and a step along it would be noise divided by noise.
        """
        layout = self.objective.layout
        learned = ~layout.members(("physical",) if layout.physical else ())
        largest = np.max(np.diag(normal), where=learned, initial=0.0)
        return np.diag(np.where(learned, _ROUNDING * largest, 0.0))

    def reported_jacobian(self, raw: FloatArray) -> FloatArray:
        """Return d(reported)/d(moving raw), shape (reported, moving)."""
        return self.reported.jacobian(raw)[:, self.moving]

    def better(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return which of two raw parameters (parameter,) has less loss, the first if both."""
        losses = [np.nan_to_num(self.gauss_newton(raw).loss, nan=np.inf) for raw in (first, second)]
        return second if losses[1] < losses[0] else first

    def spread(self, step: FloatArray) -> FloatArray:
        """Return a step of the moving parameters as one of all, zero elsewhere."""
        full = np.zeros(len(self.moving))
        full[self.moving] = step
        return full


@dataclass(frozen=True, eq=False)
class Solution:
    """Where an optimiser stopped.

    Attributes
    ----------
    raw : ndarray, shape (parameter,)
        Raw parameters.
    terms : GaussNewtonTerms
        Loss and Gauss-Newton terms of the moving parameters there.
    evaluations : int
        Gauss-Newton evaluations, or epochs.
    outcome : str
        Why it stopped, as a sentence.
    """

    raw: FloatArray
    terms: GaussNewtonTerms
    evaluations: int
    outcome: str

    @property
    def converged(self) -> bool:
        """Whether it stopped because nothing that is reported moves."""
        return self.outcome == CONVERGED


class Optimiser(Protocol):
    """Anything that lowers the loss of a `Problem`."""

    def minimise(
        self, problem: Problem, raw: FloatArray, progress: Progress = ignore_progress
    ) -> Solution:
        """Return the best parameters reached from `raw` (parameter,)."""
        ...


class PriorRule(Protocol):
    """Gives what is learned a prior, horizon by horizon."""

    def joined(self, problem: Problem, raw: FloatArray, cold: bool) -> tuple[Problem, FloatArray]:
        """Return the problem with a prior in its loss, and where training begins.

        `raw` (parameter,) is where it would begin, `cold` whether nothing was trained before.
        """
        ...


@dataclass(frozen=True)
class Stage:
    """One horizon of training.

    Attributes
    ----------
    horizon : int
        Steps.
    optimiser : Optimiser
    groups : tuple of str or None
        Parameter groups that move; None moves all.
    """

    horizon: int
    optimiser: Optimiser
    groups: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Plan:
    """Ordered stages, each warm-started by the one before.

    Attributes
    ----------
    stages : tuple of Stage
    placement : Placement
        Where windows start: jittered by default, `Contiguous` for the paper's mode.
    solver : Solver
        Turns the model into a predictor; classic Runge-Kutta by default.
    hold : Hold
        The input between samples; constant by default.
    loss : Loss
        What is squared and summed; the paper's training loss by default.
    detour : Optimiser or None
        Trains once more at the chosen horizon from the start alone, to see whether the answer
        depends on the path; left out by default.
    learned_prior : PriorRule or None
        Gives what is learned a prior at every horizon; none by default.
    discrepancy : bool
        Whether deviations grow by what the model leaves out; not by default.

    Raises
    ------
    InputError
        If there is no stage.
    """

    stages: tuple[Stage, ...]
    placement: Placement = DEFAULT_PLACEMENT
    solver: Solver = DEFAULT_SOLVER
    hold: Hold = DEFAULT_HOLD
    loss: Loss = DEFAULT_LOSS
    detour: Optimiser | None = None
    learned_prior: PriorRule | None = None
    discrepancy: bool = False

    def __post_init__(self) -> None:
        if not self.stages:
            raise InputError("stages must hold at least one horizon, got none.")
