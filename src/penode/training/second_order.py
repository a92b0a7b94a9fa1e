"""Levenberg-Marquardt on streamed Gauss-Newton terms, stopped by what is reported."""

from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.training.covariance import ScoreSeries, sandwich_deviation
from penode.training.gauss_newton_terms import GaussNewtonTerms
from penode.training.local_loss import LocalLoss
from penode.training.plan import CONVERGED, DIVERGED, Problem, Progress, Solution, ignore_progress

_LARGEST_DAMPING = 1e10
#: Directions of the normal matrix weaker than this are left out of the remaining step: the loss
#: creeps along them for many iterations without moving anything that is reported.
_CREEP = 1e-4
#: A fraction of the loss that the remaining step must not take away: while the model does not yet
#: fit, the deviations are as large as the misfit and nothing seems to move.
_MISFIT = 5e-4
#: Squared error, in variances of a residual, that is not worth a shorter step than one that failed.
_NOTHING = 1e-3
#: Least damping after a step was rejected.
_RESTRAINED = 1e-3
#: Least fraction of a step.
_SHORTEST = 0.1


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Damped Gauss-Newton with Marquardt's scaling, so that units do not matter.

    The damping follows the ratio of achieved and promised decrease smoothly, and grows faster
    with every rejection in a row (H. B. Nielsen, Damping parameter in Marquardt's method,
    IMM-REP-1999-05, DTU, 1999). Steps are shortened where the loss bends more than promised.

    Attributes
    ----------
    evaluations : int
        Most evaluations of the Gauss-Newton terms.
    tolerance : float
        Stop when the remaining step is below this many standard deviations in every physical
        parameter and below five times as many, in root mean square, in the learned map.
    damping : float
        First damping, relative to the scaled diagonal.
    """

    evaluations: int = 40
    tolerance: float = 0.1
    damping: float = 1e-3

    def minimise(
        self, problem: Problem, raw: FloatArray, progress: Progress = ignore_progress
    ) -> Solution:
        """Lower the loss from `raw`.

        Parameters
        ----------
        problem : Problem
            What is minimised, over which windows, moving which parameters.
        raw : ndarray, shape (parameter,)
            Where to begin.
        progress : callable
            Receives the raw parameters and the loss before each step.

        Returns
        -------
        Solution
            The lowest loss seen; a start whose rollouts diverge is given back as it came.
        """
        terms = problem.gauss_newton(raw)
        damping, growth, reach = self.damping, 2.0, 1.0
        if not terms.finite:
            return Solution(raw, terms, 1, DIVERGED)
        for evaluation in range(1, self.evaluations):
            progress(raw, terms.loss)
            # One step at least: horizons are compared by differences far below one deviation.
            local = LocalLoss(problem, raw, terms)
            if evaluation > 1 and self._converged(local):
                return Solution(raw, terms, evaluation, CONVERGED)
            step = reach * local.step(damping)
            candidate = raw + problem.spread(step)
            trial = problem.gauss_newton(candidate)
            gain, nothing = _gain(local, trial, step), _NOTHING * terms.loss / terms.count
            reach = _reach(reach, gain)
            if gain > 0:
                raw, terms = candidate, trial
                damping, growth = max(damping * _after(gain), 1e-12), 2.0
            elif damping > _LARGEST_DAMPING or local.promised(step) <= nothing:
                return Solution(raw, terms, evaluation, "No step lowers the loss any more.")
            else:
                damping, growth = max(damping * growth, _RESTRAINED), growth * 2
        return Solution(raw, terms, self.evaluations, "The evaluations are used up.")

    def _converged(self, local: LocalLoss) -> bool:
        problem, terms = local.problem, local.terms
        jacobian = problem.reported_jacobian(local.raw)
        step = local.step(_CREEP)
        if not len(jacobian):  # nothing is reported: the loss decides
            return bool(terms.descent @ step <= 1e-10 * terms.loss * terms.count)
        if local.promised(step) > _MISFIT * terms.loss:
            return False
        left = jacobian @ step
        deviation = sandwich_deviation(terms, jacobian, ScoreSeries.of_windows(problem.windows))
        with np.errstate(over="ignore"):
            ratio = np.minimum(np.abs(left) / np.maximum(deviation, 1e-300), 1e9)
        physical = len(problem.objective.layout.physical)
        learned = np.sqrt(np.mean(ratio[physical:] ** 2)) if len(ratio) > physical else 0.0
        return bool(max(*ratio[:physical], learned / 5, 0.0) < self.tolerance)


def _gain(local: LocalLoss, trial: GaussNewtonTerms, step: FloatArray) -> float:
    """Return a step's decrease of the loss, as a fraction of what the local loss promised.

    Negative infinity for a trial that diverged.
    """
    if not trial.finite:
        return -np.inf
    return (local.terms.loss - trial.loss) / max(local.promised(step), 1e-300)


def _reach(reach: float, gain: float) -> float:
    """Return the fraction of a step at which the loss was least, a parabola through what is known.

    The quadratic model fell by 2 t - t^2 along a fraction t of the step, the loss by a parabola of
    the same slope and another curvature: larger where a kink of the model is passed, such as a
    current's change of sign, and full steps would go to and fro. It grows by doubling: beyond a
    step that was taken there may be what no parabola shows.
    """
    curvature = max(2 - max(gain, -1e3) * (2 - reach), 1e-3)
    return float(np.clip(reach / curvature, _SHORTEST, min(2 * reach, 1.0)))


def _after(gain: float) -> float:
    """Return what multiplies the damping after a step of some gain: 1/3 to 2, 1 for one half."""
    return max(1 / 3, 1 - (2 * min(gain, 1.0) - 1) ** 3)
