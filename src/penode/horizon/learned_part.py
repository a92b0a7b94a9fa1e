"""A learned part beside the physics: the physics alone first, then the part, if it predicts.

A model with a learned part contains the one without it. That one is climbed first: it costs little,
and shows the hold, the sub-steps and where the physical parameters lie. From there the part is
freed, at the horizon chosen; a network, which is not linear and takes long, up the lower half of
the horizons, from the shortest on. It stays, and is climbed with, where it predicts stretches that
were left out of training better than the physics alone; elsewhere it stays as it was given.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.data.rates import lengths
from penode.data.windows import Contiguous, Windows
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.as_recorded import Begun, Climbed, climbed_as_recorded
from penode.horizon.declared_priors import with_declared_priors
from penode.horizon.default_plan import default_horizons
from penode.horizon.hold_check import with_hold
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem
from penode.horizon.learned_prior import LearnedPrior, is_linear, with_priors
from penode.horizon.search import Found, Guesses, Search
from penode.horizon.selection import Longest
from penode.models.base import Model
from penode.models.layout import Layout
from penode.models.wrapped import WithoutPart, whole_of
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt

#: Parts of the recordings that are left out in turn, and training with each left out.
_FOLDS, _AGAIN = 4, LevenbergMarquardt(evaluations=12)
#: A mean square that is rounding; the inverse of one that diverged.
_EXACT = 1e-24
#: Trainings of the part before it is judged, each with the prior estimated after the one before.
_ROUNDS = 2
#: Before it is judged, a network is trained at every second rung.
_EVERY = 2
#: The prior where training begins near the minimum.
_NEAR = LearnedPrior(first=None)
#: Rungs below the one chosen without the part at which the climb with it begins.
_BELOW = 3


def searched(search: Search, plan: Plan) -> Found:
    """Return what recordings show of a start, with its learned part where they support it."""
    physics = WithoutPart.of(search.start.model)
    if physics is None or plan.loss.penalties:
        return _as_recorded(search, plan)
    without = replace(search, start=replace(search.start, model=physics))
    network = not is_linear(Layout(search.start.model))
    half = replace(plan, stages=plan.stages[: len(plan.stages) // 2 + 1])
    try:
        alone = _as_recorded(without, half if network else plan)
    except InputError:  # the physics is nothing without the part
        return _as_recorded(search, plan)
    if alone.climbed.climb.interrupted or alone.check.interrupted:
        return alone
    try:
        try:
            trial = _Trial.of(search, alone.climbed)
            if trial.supported:
                return trial.climbed_with(search, alone.climbed, plan.stages)
        except InputError:  # freed, the part makes predictions diverge
            trial = _Trial(0, alone.climbed, np.full(_FOLDS, np.nan))
        if network:  # it was climbed half way
            alone = _as_recorded(without, plan)
    except KeyboardInterrupt:
        horizon = alone.climbed.climb.fits[alone.climbed.choice.index].horizon
        search.observer({"event": "stop", "horizon": horizon})
        return replace(alone, check=replace(alone.check, interrupted=True))
    return replace(alone, start=trial.noted(alone.start))


def restored(fit: Fit) -> Fit:
    """Return a fit whose model has its learned part as parameters again, as it was given."""
    whole, band = whole_of(fit.model), fit.learned_uncertainty
    if whole is fit.model:
        return fit
    layout: Layout[Model] = Layout(whole)
    kept = ~layout.members(("learned",))
    covariance = np.zeros((layout.size, layout.size))
    covariance[np.ix_(kept, kept)] = band.covariance
    agreeing = np.tile(layout.raw(whole), (len(band.agreeing), 1))
    agreeing[:, kept] = band.agreeing
    return replace(
        fit,
        model=whole,
        simulation=None if fit.simulation is None else whole_of(fit.simulation),
        learned_uncertainty=replace(band, covariance=covariance, agreeing=agreeing),
    )


def _as_recorded(search: Search, plan: Plan) -> Found:
    """Return what a climb shows with the hold and the priors that the recordings ask for."""
    start, experiments = search.start, search.experiments
    plan = with_priors(with_hold(plan, start, experiments), start)
    return search.as_recorded(with_declared_priors(plan, start, experiments))


@dataclass(frozen=True, eq=False)
class _Trial:
    """The part trained at one horizon, beside the physics alone at the same rung.

    `gains` (fold,) are what the part takes off the logarithm of the error of what is left out.
    """

    index: int
    part: Climbed
    gains: FloatArray

    @classmethod
    def of(cls, search: Search, alone: Climbed) -> "_Trial":
        """Return the trial at the chosen rung, or at the longest that leaves parts to leave out."""
        fits, experiments = alone.climb.fits, search.experiments
        most = _part_left_out(experiments)
        index = max(k for k in range(alone.choice.index + 1) if not k or fits[k].horizon <= most)
        part = _freed(search, alone, index)
        if part.climb.interrupted:
            raise KeyboardInterrupt
        errors = [_left_out(alone, index), _left_out(part, len(part.climb.fits) - 1)]
        logarithms = 0.5 * np.log(np.clip(errors, _EXACT, 1 / _EXACT))
        return cls(index, part, logarithms[0] - logarithms[1])

    @property
    def supported(self) -> bool:
        """Whether the part predicts better, by more than one standard error over the folds."""
        return bool(self.gains.mean() > self.gains.std(ddof=1) / np.sqrt(len(self.gains)))

    def noted(self, start: Start) -> Start:
        """Return a start that says what the trial has shown, as a warning where it is no more."""
        verdict = "stays in the model" if self.supported else "is left as it was given"
        sentence = f"The learned part {verdict}: {self._reason}."
        facts = {**start.facts, "learned_part": sentence}
        warnings = start.warnings if self.supported else (*start.warnings, sentence)
        return replace(start, facts=facts, warnings=warnings)

    @property
    def _reason(self) -> str:
        """What the errors of what is left out say, or why they say nothing."""
        error = 100 * (np.exp(-self.gains) - 1)
        if not np.isfinite(error).all():
            return "no part of the recordings can be left out of training and predicted"
        mean, chance = error.mean(), error.std(ddof=1) / np.sqrt(_FOLDS)
        way = "more" if mean > 0 else "less"
        return (
            "on quarters of the recordings that training left out, simulations err by "
            f"{abs(mean):.2g} ± {chance:.2g} % {way} with it than without"
        )

    def climbed_with(self, search: Search, alone: Climbed, stages: Sequence[Stage]) -> Found:
        """Return what is found with the part, of all stages of a climb."""
        part, most = self.part, _part_left_out(search.experiments)
        upper = tuple(
            stage
            for k, stage in enumerate(stages)
            if k >= self.index - _BELOW and (k <= self.index or stage.horizon <= most)
        )
        plan = replace(part.plan, stages=upper, detour=None, learned_prior=_NEAR)
        start = self.noted(replace(search.start, model=part.climb.fits[-1].model))
        guesses = alone.problem.guesses.get(upper[0].horizon, ())
        return replace(search, start=start, guesses=guesses).with_hold_of(plan)


def _freed(search: Search, alone: Climbed, index: int) -> Climbed:
    """Return the part trained at a rung of the physics alone, with hold and steps it wants."""
    physics, experiments = alone.climb.fits[index].model, search.experiments
    assert isinstance(physics, WithoutPart)
    start = replace(search.start, model=physics.whole)
    linear = is_linear(Layout(start.model))
    rungs = (index,) * _ROUNDS if linear else (*range(0, index, _EVERY), index)
    stages = tuple(replace(alone.plan.stages[k], optimiser=_AGAIN) for k in rungs)
    plan = replace(alone.plan, stages=stages, loss=replace(alone.plan.loss, penalties=()))
    plan = with_declared_priors(with_priors(plan, start), start, experiments)
    prior = _NEAR if linear else LearnedPrior()

    def climbed(plan: Plan, begun: Begun | None) -> Climbed:
        problem = LadderProblem.of(start.model, experiments, plan, search.observer)
        problem.guesses.update(alone.problem.guesses)
        problem.begun.update(begun or {})
        climb = problem.climb(plan, problem.objective.layout.raw(start.model))
        return Climbed(problem, plan, climb, Longest().select(climb.fits))

    return climbed_as_recorded(replace(plan, learned_prior=prior), climbed)


def _left_out(climbed: Climbed, index: int) -> FloatArray:
    """Return mean squared errors at windows left out in turn, of a rung trained without, (fold,).

    Windows are as long as the recording allows: free runs whose starts are estimated.
    """
    plan, ladder, rung = climbed.plan, climbed.problem, climbed.climb.fits[index]
    trained = ladder.problem(plan.stages[index], plan)
    objective, raw = trained.objective, rung.solution.raw
    longest = default_horizons(ladder.model, ladder.experiments)[-1]
    horizon = min(_part_left_out(ladder.experiments), longest)
    guesses: Guesses = ladder.hidden_states(objective, rung.solution, trained.windows)
    placed = replace(plan, placement=Contiguous())
    beside = replace(ladder, guesses={horizon: guesses})
    seen = beside.problem(Stage(horizon, _AGAIN), placed).windows
    fold = _FOLDS * np.arange(len(seen)) // len(seen)
    apart, errors = objective.with_penalties(()), []
    for k in range(_FOLDS):
        unseen = seen.among(fold == k)
        rest = trained.windows.among(~_overlapping(trained.windows, unseen))
        if not len(rest):
            return np.full(_FOLDS, np.nan)
        again = _AGAIN.minimise(replace(trained, windows=rest), raw)
        error = apart.gauss_newton(again.raw, unseen).loss
        errors.append(np.nan_to_num(error, nan=np.inf))
    return np.array(errors)


def _part_left_out(experiments: Sequence[Experiment]) -> int:
    """Return the steps of a part that is left out; windows that are longer cannot be judged."""
    return max(max(lengths(experiments)) // _FOLDS - 1, 1)


def _overlapping(windows: Windows, others: Windows) -> BoolArray:
    """Return which windows share samples with others, (window,)."""
    begin, end = windows.starts - windows.past + 1, windows.starts + windows.steps
    first, last = others.starts - others.past + 1, others.starts + others.steps
    return np.asarray(np.any((begin[:, None] <= last) & (end[:, None] >= first), axis=1))
