"""Recordings that were not trained on: an objection where the fit does not predict them.

Their own noise, and currents (any states) where training has not been, excuse errors. Another speed
or a machine some 20 K warmer cause errors well below the limits here.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.outcome import Objection
from penode.models.measured import dynamic_states
from penode.validation.comparison import Comparison, finite_residual, stretches_of, together
from penode.validation.free_run import free_run_errors

#: Free-run error over what a state moves from which a recording is not predicted: so many times
#: that of training, but never below the first nor above the second of the limits.
_TIMES, _LIMITS = 10.0, (0.25, 0.5)
#: Single steps fail from this fraction of what a state moves in a step, of what it moves at all,
#: and from so many times their error in training.
_OF_A_STEP, _OF_ALL, _TIMES_A_STEP = 0.5, 0.1, 2.0
#: A state moves at least by this fraction of one of the same unit, and of what it moved in
#: training, where single steps are judged.
_BESIDE, _SMALLEST = 0.2, 0.05
#: Fraction of the samples in the excited region from which a free run is one within it.
_INSIDE = 0.9
#: Errors of windows of the chosen horizon over those of the best shorter ones that are alike.
_ALIKE = 1.2
#: Free-run error over what a state moves from which a free run is said to diverge.
_DIVERGES = 100.0
#: Variance of the third differences of white noise of variance 1.
_THIRD = 20.0
_REPAIR = (
    "Check that it is a recording of the same machine, with the same signs, units and timing "
    "(penode check); where nothing differs, identify from both."
)


def validation_fails(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection for each recording that was not trained on and is not predicted."""
    errors = [_Errors.of(stretches) for stretches in stretches_of(fit.comparisons)]
    trained = [one for one in errors if one.whole.role == "train"]
    for one in errors:
        if one.whole.role != "train":
            yield from _judged(fit, one, trained, experiments)


def unpredictable(fit: Fit, moves: FloatArray, experiments: Sequence[Experiment]) -> bool:
    """Return whether free runs through whole recordings are beyond a model that is right.

    In a free run of an unstable plant under feedback, or of one in chaotic motion, the smallest
    error grows without bound. Windows of the chosen horizon err no more than shorter ones; and the
    run fails from the measured first sample alone, not from an estimated start, or its own
    deviation exceeds half of what a state moves (state,).
    """
    ladder = fit.horizon.ladder
    errors = [rung.rmse for rung in ladder if rung.horizon <= fit.horizon.selected]
    scaled = len(set(fit.comparisons[0].units)) > 1
    size = 1.0 if scaled else float(moves.max())
    if len(errors) < 2 or not errors[-1] <= min(_ALIKE * min(errors), _LIMITS[0] * size):
        return False
    if fit.predictor is None or not np.isfinite(fit.covariance).all():
        return False
    models = [[fit.model] * len(experiments)]
    free, measured = (
        free_run_errors(fit.predictor, models, experiments, freed)
        for freed in (dynamic_states(fit.model), None)
    )
    if (free <= _LIMITS[0] * moves).all() and not (measured <= _LIMITS[1] * moves).all():
        return True
    bands = np.concatenate([fit.free_run_deviation(one) for one in experiments])
    with np.errstate(over="ignore"):  # they may grow beyond any number
        wide = _rms(np.nan_to_num(bands, nan=np.inf)) > _LIMITS[1] * moves
    return bool(wide.any())


@dataclass(frozen=True, eq=False)
class _Errors:
    """The errors of a recording, its stretches together.

    (step, state): measured states, one-step residuals, and what the states moved in the step;
    (state,): deviation of the states, free-run error, deviation of their noise.
    """

    whole: Comparison
    states: FloatArray
    residual: FloatArray
    steps: FloatArray
    moves: FloatArray
    free: FloatArray
    noise: FloatArray

    @classmethod
    def of(cls, stretches: Sequence[Comparison]) -> "_Errors":
        whole = together(stretches)
        third = [np.diff(one.measured, 3, axis=0) for one in stretches]
        moves, units = whole.measured.std(axis=0), np.array(whole.units)
        largest = np.array([moves[units == unit].max() for unit in units])
        return cls(
            whole,
            np.concatenate([one.measured[1:] for one in stretches]),
            np.concatenate([finite_residual(one) for one in stretches]),
            np.concatenate([np.diff(one.measured, axis=0) for one in stretches]),
            np.maximum(moves, np.maximum(_BESIDE * largest, 1e-300)),
            np.array(list(whole.free_run_errors.values())),
            _rms(np.concatenate(third)) / np.sqrt(_THIRD),
        )


def _judged(
    fit: Fit, one: _Errors, trained: Sequence[_Errors], experiments: Sequence[Experiment]
) -> Iterator[Objection]:
    moved = np.max([other.moves for other in trained], axis=0)
    usual = np.max([other.free / other.moves for other in trained], axis=0)
    single = np.max([_rms(other.residual) for other in trained], axis=0)
    size = np.maximum(one.moves, _SMALLEST * moved)
    limit = np.clip(_TIMES * usual, *_LIMITS) * np.maximum(one.moves, moved)
    astray = ~(_less(one.free, one.noise) <= limit)
    if astray.any() and unpredictable(fit, moved, experiments):
        astray[:] = False
    if not astray.any() and not (np.abs(one.residual) > _OF_ALL * size).any():
        return
    inside = _inside(fit, one)
    ahead, bad = _failing_steps(one, single, inside)
    if astray.any() and (inside.mean() >= _INSIDE or bad.any()):
        yield _free_run_fails(one, trained, astray)
    elif (bad & (ahead > _OF_ALL * size)).any():
        yield _steps_fail(one, single, ahead, bad & (ahead > _OF_ALL * size))


def _failing_steps(
    one: _Errors, single: FloatArray, inside: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Return one-step errors (state,) inside the excited region, less noise, and which fail."""
    error = _rms(one.residual[inside])
    # Of a step both ends are noisy.
    noise = np.sqrt(2.0) * one.noise
    ahead = _less(error, np.maximum(single, noise))
    moves = np.maximum(_less(_rms(one.steps[inside]), noise), noise)
    return ahead, (ahead > _OF_A_STEP * moves) & (error > _TIMES_A_STEP * single)


def _free_run_fails(one: _Errors, trained: Sequence[_Errors], astray: BoolArray) -> Objection:
    k = int(np.argmax(np.where(astray, one.free / one.moves, 0.0)))
    unit, usual = one.whole.units[k], max(float(other.free[k]) for other in trained)
    diverges = not one.free[k] < _DIVERGES * one.moves[k]
    error = "diverges" if diverges else f"errs by {one.free[k]:.3g} {unit} (rms)"
    return Objection(
        "validation fails",
        f"{one.whole.name}: the free run of {one.whole.states[k]}, which moves by "
        f"{one.whole.measured[:, k].std():.3g} {unit} (rms), {error} on this recording, which was "
        f"not trained on; in training it errs by {usual:.3g} {unit}.",
        _REPAIR,
    )


def _steps_fail(one: _Errors, single: FloatArray, ahead: FloatArray, bad: BoolArray) -> Objection:
    k = int(np.argmax(np.where(bad, ahead / one.moves, 0.0)))
    unit = one.whole.units[k]
    return Objection(
        "validation fails",
        f"{one.whole.name}: single steps of {one.whole.states[k]} err by {ahead[k]:.3g} {unit} on "
        f"this recording, which was not trained on, and by {single[k]:.3g} {unit} in training.",
        _REPAIR,
    )


def _inside(fit: Fit, one: _Errors) -> BoolArray:
    """Return which steps end in the excited region; all where not every state is measured."""
    if tuple(fit.model.states) != one.whole.states:
        return np.ones(len(one.states), dtype=bool)
    return fit.supported(one.states)


def _less(error: FloatArray, noise: FloatArray) -> FloatArray:
    """Return an error without the part that independent noise has in it."""
    return np.asarray(np.sqrt(np.maximum(error**2 - noise**2, 0.0)))


def _rms(values: FloatArray) -> FloatArray:
    """Return root mean squares (state,) of values (time, state); nothing has none."""
    return np.asarray(np.sqrt(np.sum(values**2, axis=0) / max(len(values), 1)))
