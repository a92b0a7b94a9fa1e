"""The profile of the likelihood over one physical parameter, all others estimated anew."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, float64, one_blas_thread
from penode.data.experiment import Experiment, require_recordings
from penode.errors import InputError, did_you_mean
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.horizon.default_plan import default_plan
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.training.noise_scale import with_scale
from penode.training.plan import DIVERGED, Plan, Problem, Stage
from penode.training.second_order import LevenbergMarquardt

#: Evaluations with which the others follow one step of the parameter.
_EVALUATIONS = 40
#: Rise of -2 log likelihood at the ends of a 95 % interval.
_RISE_95 = NORMAL_95**2


@dataclass(frozen=True, eq=False)
class Profile:
    """How much likelihood is lost where a parameter is held beside its estimate.

    Attributes
    ----------
    parameter, unit : str
    values : ndarray, shape (value,)
        Of the parameter, ascending, in its SI unit; the middle one is the estimate of the horizon.
    rise : ndarray, shape (value,)
        Of -2 log likelihood over its least; infinite where predictions diverge. Residuals of
        overlapping windows are no independent ones, so near the estimate it is scaled to what the
        reported deviation of that horizon says: what differs from a parabola is shape.
    """

    parameter: str
    unit: str
    values: FloatArray
    rise: FloatArray

    @property
    def interval_95(self) -> tuple[float, float]:
        """Where the rise is 3.84; infinite on a side where it stays below."""
        least, ends = int(np.argmin(self.rise)), []
        for side in (slice(least, None, -1), slice(least, None)):
            rise, values = self.rise[side], self.values[side]
            above = np.flatnonzero(rise > _RISE_95)
            sign = -1.0 if side.step else 1.0
            if not above.size:
                ends.append(sign * np.inf)
                continue
            k = int(above[0])
            # A parabola's root is straight between two values.
            low, high = np.sqrt(np.maximum(rise[k - 1], 0.0)), np.sqrt(min(rise[k], 1e12))
            share = (NORMAL_95 - low) / (high - low)
            ends.append(float(values[k - 1] + share * (values[k] - values[k - 1])))
        return ends[0], ends[1]


@one_blas_thread
def profile(
    fit: Fit,
    experiments: Sequence[Experiment],
    parameter: str,
    *,
    reach: float = 3.0,
    points: int = 4,
    plan: Plan | None = None,
) -> Profile:
    """Profile the likelihood over a physical parameter at the horizon that was chosen.

    Parameters
    ----------
    fit : Fit
        Of a model of one's own.
    experiments : sequence of Experiment
        The recordings that it was trained on.
    parameter : str
        Key of ``fit.parameters``.
    reach : float
        How far to go on either side, in reported deviations of that horizon.
    points : int
        Values on either side of the estimate, evenly spaced, at least 2.
    plan : Plan, optional
        With which the fit was made; by default `penode.engine.default_plan`.

    Returns
    -------
    Profile
        A narrow valley that bends, or a side that stays open, shows here and not in a deviation.

    Raises
    ------
    InputError
        If there is no such parameter, its deviation is not known, no horizon was chosen, or points
        or reach are too small.

    Notes
    -----
    Raue et al., Bioinformatics 25 (2009) 1923, doi:10.1093/bioinformatics/btp358.
    """
    require_recordings(experiments, ())
    deviation = _deviation(fit, parameter)
    if points < 2 or not reach > 0:
        raise InputError(f"points must be >= 2 and reach > 0, got {points} and {reach:g}.")
    problem, raw = problem_of(fit, experiments, plan, fit.horizon.selected)
    layout = problem.objective.layout
    place = int(np.flatnonzero(layout.physical_members)[layout.physical.index(parameter)])
    step, held = deviation * reach / points, problem.moving.copy()
    held[place] = False
    best = minimised(problem, raw)
    if best is None:
        raise InputError(f"{parameter}: the predictions diverge at horizon {fit.horizon.selected}.")
    loss, raw = best
    centre = float(physical_of(problem, raw)[layout.physical.index(parameter)])
    values: FloatArray = centre + step * np.arange(-points, points + 1, dtype=np.float64)
    following = replace(problem, moving=held)
    below, above = (
        [*_along(following, raw, parameter, side)]
        for side in (values[:points][::-1], values[points + 1 :])
    )
    near = [side[0] - loss for side in (below, above) if np.isfinite(side[0])]
    curvature = max(float(np.mean(near)) if near else 0.0, 1e-300)
    rise = np.array([*below[::-1], loss, *above]) - loss
    scale = (reach / points) ** 2 / curvature
    unit = fit.parameters[parameter].unit
    return Profile(parameter, unit, values, np.asarray(rise * scale, dtype=np.float64))


def _deviation(fit: Fit, parameter: str) -> float:
    """Return the deviation of a parameter at the chosen horizon; refuse what has none."""
    if parameter not in fit.parameters:
        known = ", ".join(fit.parameters)
        hint = did_you_mean(parameter, fit.parameters)
        raise InputError(f"parameter must be one of {known}, got {parameter!r}{hint}.")
    chosen = [rung for rung in fit.horizon.ladder if rung.horizon == fit.horizon.selected]
    deviation = chosen[0].std.get(parameter) if chosen else None
    if fit.predictor is None or deviation is None or not np.isfinite(deviation) or deviation <= 0:
        raise InputError(
            f"{parameter} must have a deviation at horizon {fit.horizon.selected}, got none; a "
            "profile of what the recordings cannot show has no scale."
        )
    return float(deviation)


def problem_of(
    fit: Fit, experiments: Sequence[Experiment], plan: Plan | None, horizon: int
) -> tuple[Problem, FloatArray]:
    """Return the problem of a horizon, and the fit's raw parameters."""
    assert fit.predictor is not None
    plan = plan or default_plan(fit.model, experiments)
    stage = Stage(horizon, LevenbergMarquardt(_EVALUATIONS))
    plan = replace(plan, stages=(stage,), solver=fit.predictor.solver, hold=fit.predictor.hold)
    ladder = LadderProblem.of(fit.model, experiments, plan, ignore_events)
    problem, raw = ladder.problem(stage, plan), ladder.objective.layout.raw(fit.model)
    problem, raw = with_scale(problem, raw, cold=False)
    if plan.learned_prior:
        problem, raw = plan.learned_prior.joined(problem, raw, cold=False)
    return problem, raw


def physical_of(problem: Problem, raw: FloatArray) -> FloatArray:
    """Return the physical parameters (physical,) of raw ones, SI units."""
    layout = problem.objective.layout
    with float64():
        return np.array(layout.physical_values(layout.values(jnp.asarray(raw))))


def minimised(problem: Problem, raw: FloatArray) -> tuple[float, FloatArray] | None:
    """Return the least loss and its raw parameters; None where predictions diverge."""
    optimiser = LevenbergMarquardt(_EVALUATIONS)
    solution = optimiser.minimise(problem, raw, lambda *_: None)
    return None if solution.outcome == DIVERGED else (float(solution.terms.loss), solution.raw)


def _along(
    problem: Problem, raw: FloatArray, parameter: str, values: FloatArray
) -> Iterator[float]:
    """Yield the least loss at each value, the others from where they were at the one before."""
    layout = problem.objective.layout
    number, found = layout.physical.index(parameter), (0.0, raw)
    for value in values:
        own = physical_of(problem, found[1])
        own[number] = value
        try:
            there = minimised(problem, layout.with_physical(found[1], own))
        except ValueError:  # beyond the parameter's bounds
            there = None
        if there is None:
            yield np.inf
        else:
            found = there
            yield there[0]
