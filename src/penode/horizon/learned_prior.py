"""A prior of every learned part by default: as large and as smooth as the data favour.

What the map adds to the derivative is believed to be a Gaussian process with mean zero. So an
unneeded map shrinks to nothing, and one that is needed returns to nothing where nothing was
recorded. What the physical terms beside it can do is theirs alone.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from penode.arrays import BoolArray, FloatArray, float64, on_device
from penode.horizon.identifiability import Start
from penode.models.base import Model
from penode.models.layout import Layout
from penode.training.coarse_to_fine import CoarseToFine
from penode.training.covariance import ScoreSeries
from penode.training.evidence import Information, Rows, process_rows
from penode.training.learned_effect import LearnedEffect, Visits
from penode.training.penalties import GaussianPrior
from penode.training.plan import DIVERGED, Optimiser, Plan, Problem
from penode.training.second_order import LevenbergMarquardt

#: Points at which the map is believed to be a Gaussian process, and how much further out than the
#: visits, from their middle, as many more lie.
_POINTS, _BEYOND = 60, 1.3
#: Amplitudes in deviations of the derivative, and lengths in ranges of what was visited.
_AMPLITUDES, _LENGTHS = 10.0 ** np.arange(-5.0, 1.3, 0.5), 2.0 ** np.arange(-4.0, 0.1)
#: A combination of physical parameters is the learned map's too if this much of its square is.
_SHARED = 0.7
#: Deviation of the map along such a combination, in deviations of the derivative.
_ALONG = 1e-4
#: Deviation of a parameter that no point shows, over that of one that they show.
_UNSEEN = 3.0
#: Trainings of a map that is not linear, each with the prior estimated where it begins: without
#: one, a network moves for long along what changes nothing.
_ROUNDS = 4
#: Trains first where nothing was trained before.
_FIRST = CoarseToFine(LevenbergMarquardt(evaluations=60))


@dataclass(frozen=True)
class LearnedPrior:
    """Smoothness and scale of a learned part, estimated where each horizon's training begins.

    Attributes
    ----------
    orthogonal : bool
        Whether the map has nothing of what the physical terms beside it can do; these mean then
        what they do without the map. Otherwise the data share it out, as far as they can.
    first : Optimiser or None
        Trains first where nothing was trained before, what is linear without a prior; None where
        training begins near the minimum.
    """

    orthogonal: bool = True
    first: Optimiser | None = _FIRST

    def joined(self, problem: Problem, raw: FloatArray, cold: bool) -> tuple[Problem, FloatArray]:
        """Return the problem with the prior, and where training begins (see `PriorRule`)."""
        objective = problem.objective
        if not (problem.moving & _members(objective.layout)).any():
            return problem, raw
        first = self.first if cold else None
        if first is None:
            return self._believing(problem, raw), raw
        linear = is_linear(objective.layout)
        believing = problem if linear else self._believing(problem, raw)
        for _ in range(1 if linear else _ROUNDS):
            solution = first.minimise(believing, raw)
            if solution.outcome == DIVERGED:
                return problem, raw
            raw = solution.raw
            believing = self._believing(problem, raw)
        return believing, raw

    def _believing(self, problem: Problem, raw: FloatArray) -> Problem:
        """Return the problem with the prior estimated at raw (parameter,), if the map matters."""
        prior, objective = self.estimated(problem, raw), problem.objective
        if prior is None:
            return problem
        penalties = (*objective.loss.penalties, prior)
        return replace(problem, objective=objective.with_penalties(penalties))

    def estimated(self, problem: Problem, raw: FloatArray) -> GaussianPrior | None:
        """Return the prior that the data favour; None where the map is of no effect.

        Parameters
        ----------
        problem : Problem
            Of one horizon.
        raw : ndarray, shape (parameter,)
            About which the map is taken as linear.
        """
        layout = problem.objective.layout
        alone = replace(problem, objective=problem.objective.with_penalties(()))
        terms = alone.gauss_newton(raw)
        belief = _Belief.of(problem, raw, self.orthogonal)
        if not (terms.finite and belief.effective):
            return None
        series = ScoreSeries.of_windows(problem.windows)
        if not series.long_enough:
            given = raw, problem.windows, terms.starts
            scores = alone.objective.sample_scores(*given)[problem.moving]
            terms, series = replace(terms, scores=scores), ScoreSeries.of_samples(scores)
        data = Information.of(terms, _members(layout)[problem.moving], series)
        rows = belief.rows(*belief.most_likely(data))
        scale = np.sqrt(data.variance / terms.count)
        factor = scale * rows.slopes
        mean = factor @ belief.values - scale * rows.here
        return GaussianPrior(factor, np.full(len(factor), scale**2), mean)


def with_priors(plan: Plan, start: Start) -> Plan:
    """Return a plan that gives a learned part and what the model leaves out priors.

    A plan with penalties says already what is believed of the learned part; a start with checks of
    its own, which calibrates its recordings, has no prior of what its model leaves out.
    """
    learned = _members(Layout(start.model)).any() and not plan.loss.penalties
    prior = plan.learned_prior or (LearnedPrior() if learned else None)
    return replace(plan, learned_prior=prior, discrepancy=plan.discrepancy or not start.checks)


@dataclass(frozen=True, eq=False)
class _Belief:
    """What is believed of the learned part but for its amplitude and length.

    About `values` (learned,) the map is linear: `effect` (output, point) and `slopes` (output,
    point, learned) at `points` (point, channel), in ranges of what was visited.
    """

    values: FloatArray
    points: FloatArray
    effect: FloatArray
    slopes: FloatArray
    # Parameters that no point shows, believed to be as small as the amplitude says.
    unseen: Rows
    # What is believed whatever the amplitude.
    fixed: Rows

    @classmethod
    def of(cls, problem: Problem, raw: FloatArray, orthogonal: bool) -> "_Belief":
        layout = problem.objective.layout
        visits = Visits.of(problem.objective.error, raw, problem.windows)
        effect = LearnedEffect.of(layout, raw, visits)
        points, scaled = _points(visits, effect.channels(visits))
        here, slopes = effect.at(points)
        shown = np.abs(slopes).max(axis=(1, 2)) > 0
        with float64():
            values = np.asarray(layout.values(on_device(raw)))[layout.value_members(("learned",))]
        size = np.abs(slopes).max(axis=(0, 1), initial=0.0)
        typical = np.median(size[size > 0]) if (size > 0).any() else 1.0
        none = Rows(np.zeros((0, len(values))), np.zeros(0))
        if is_linear(layout):
            weak = np.eye(len(values)) * typical / _UNSEEN
            unseen, fixed = Rows(weak, weak @ values), none
        else:  # about where training ended, as far as weights are large
            weak = np.eye(len(values)) / (_UNSEEN * max(1.0, np.abs(values).max()))
            unseen, fixed = none, Rows(weak, np.zeros(len(values)))
        if orthogonal:
            fixed = fixed.with_rows(_along(effect, visits))
        return cls(values, scaled, here[shown], slopes[shown], unseen, fixed)

    @property
    def effective(self) -> bool:
        """Whether the map does anything, and all that is finite."""
        return bool(self.effect.size and np.isfinite(self.slopes).all())

    def rows(self, length: float, amplitude: float) -> Rows:
        """Return all that is believed at a length, in ranges, and an amplitude."""
        white = self._white[length]
        process = Rows(white[:, :-1], white[:, -1]).with_rows(self.unseen)
        scaled = Rows(process.slopes / amplitude, process.here / amplitude)
        return scaled.with_rows(self.fixed)

    def most_likely(self, data: Information) -> tuple[float, float]:
        """Return the length and the amplitude at which the data are most likely."""
        pairs = product(_LENGTHS.tolist(), _AMPLITUDES.tolist())
        return max(pairs, key=lambda pair: self.rows(*pair).evidence(data))

    @cached_property
    def _white(self) -> dict[float, FloatArray]:
        """The map and, in the last column, its value, whitened at each length, (row, column)."""
        both = np.concatenate([self.slopes, self.effect[..., None]], axis=-1)
        columns = both.shape[-1]
        return {
            length: process_rows(self.points, length, both).reshape(-1, columns)
            for length in _LENGTHS.tolist()
        }


def is_linear(layout: Layout[Model]) -> bool:
    """Whether all that is learned is linear in its parameters."""
    return bool(layout.linear_members[_members(layout)].all())


def _members(layout: Layout[Model]) -> BoolArray:
    """Return which raw parameters are learned, shape (parameter,)."""
    groups = {setting.group for setting in layout.settings}
    return layout.members(("learned",) if "learned" in groups else ())


def _points(visits: Visits, matters: BoolArray) -> tuple[Visits, FloatArray]:
    """Return visits spread out and others further out, and the channels that matter in ranges."""
    channels = visits.channels
    span = np.maximum(np.ptp(channels, axis=0), 1e-300)
    inner = channels[_spread_out((channels / span)[:, matters], _POINTS)]
    middle = (channels.max(axis=0) + channels.min(axis=0)) / 2
    outer = np.where(matters, middle + _BEYOND * (inner - middle), inner)
    chosen = np.concatenate([inner, outer])
    return visits.at(chosen), (chosen / span)[:, matters]


def _spread_out(points: FloatArray, count: int) -> list[int]:
    """Return the places of points (point, channel) that lie far from each other."""
    distance = np.sum((points - points.mean(axis=0)) ** 2, axis=1)
    chosen = [int(np.argmax(distance))]
    distance = np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        nearest = np.sum((points - points[chosen[-1]]) ** 2, axis=1)
        distance = np.minimum(distance, nearest)
        if distance.max() < 1e-10:
            break
        chosen.append(int(np.argmax(distance)))
    return chosen


def _along(effect: LearnedEffect, visits: Visits) -> Rows:
    """Return the map's parts along what physical parameters can do too."""
    here, slopes = effect.at(visits)
    own, others = slopes.reshape(here.size, -1), effect.physical(visits).reshape(here.size, -1)
    beside, basis = _basis(others), _basis(own)
    directions, cosines, _ = np.linalg.svd(beside.T @ basis, full_matrices=False)
    shared = beside @ directions[:, cosines**2 > _SHARED]
    weight = 1 / (_ALONG * np.sqrt(here.shape[1]))
    return Rows(weight * shared.T @ own, weight * shared.T @ here.ravel())


def _basis(columns: FloatArray) -> FloatArray:
    """Return orthonormal columns that span those given (row, column)."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0] / size[size > 0]
    left, singular, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(left[:, singular > 1e-6 * singular.max(initial=0.0)])
