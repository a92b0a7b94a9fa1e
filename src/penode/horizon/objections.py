"""Objections: what speaks against a result however narrow its intervals are.

An interval covers the truth only where the model can explain the recording. Each check here looks
at a finished fit for one sign that it cannot, or that a value is not determined, and gives the
reason and the cheapest fix.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.left_out import left_out
from penode.fit.outcome import IMPLAUSIBLE, NOT_IDENTIFIABLE, Objection
from penode.horizon.held_out_check import unpredictable, validation_fails
from penode.models.layout import Layout
from penode.training.plan import Plan
from penode.validation.comparison import (
    HUGE,
    Comparison,
    finite_residual,
    stretches_of,
    together,
)

#: Looks at a fit and the recordings that it was trained on, and yields what speaks against it.
Check = Callable[[Fit, Sequence[Experiment]], Iterator[Objection]]

#: A free run explains a state from this fraction of its deviation down, and is far from what one
#: step explains from this many one-step errors up.
_EXPLAINED, _FAR = 0.5, 10.0
#: Fraction of the samples, and of the squared one-step error, from which few decide; how large the
#: worst of them is at least, in typical errors and as a fraction of what the state moves.
_FEW, _MOST, _ASIDE, _VISIBLE = 1e-3, 0.5, 30.0, 0.1
#: Fraction of the variance of the one-step residual that inputs and time may explain, unless free
#: runs err by less than this fraction of what a state moves.
_LEFT_OVER, _SMALL = 0.25, 0.05
#: Deviation of a state over the largest in its unit up to which it is at rest.
_AT_REST = 1e-2
#: Each channel that may explain a residual needs so many samples.
_SAMPLES = 50


def objections(
    fit: Fit, experiments: Sequence[Experiment], checks: Sequence[Check]
) -> tuple[Objection, ...]:
    """Return what all checks find; recordings in the order of the fit's training comparisons."""
    return tuple(objection for check in checks for objection in check(fit, experiments))


def guarded(check: Check, missed: list[str]) -> Check:
    """Return a check that is left out by name where it fails; `missed` gets the sentence."""

    def examine(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        try:
            yield from check(fit, experiments)
        except Exception as error:
            name = getattr(check, "__name__", "a convention").strip("_").replace("_", " ")
            missed.append(left_out(f"the check for {name}", error))

    return examine


def with_objections(fit: Fit, raised: Sequence[Objection]) -> Fit:
    """Return the fit with objections, which turn a verdict that it is right.

    The first gives the reason, of what is wrong before what is not determined; the others are
    warnings.
    """
    if not raised:
        return fit
    others = sorted(raised, key=lambda one: one.verdict != IMPLAUSIBLE)
    choice = replace(fit.horizon, objections=tuple(others))
    if choice.answered and choice.verdict != "stopped":
        first = others.pop(0)
        reason = f"{first.name.capitalize()}: {first.reason} {first.repair}"
        choice = replace(choice, verdict=first.verdict, reason=reason)
    warnings = (*(f"{o.name.capitalize()}: {o.reason} {o.repair}" for o in others), *fit.warnings)
    return replace(fit, horizon=choice, warnings=warnings)


def trained_on(
    fit: Fit, experiments: Sequence[Experiment]
) -> Iterator[tuple[Comparison, Experiment]]:
    """Yield each training recording with its predictions beside it."""
    seen = (c for c in fit.comparisons if c.role == "train")
    yield from zip(seen, experiments, strict=True)


def impossible_values(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection for each physical parameter that may be beyond its limit."""
    layout = Layout(fit.model)
    settings = dict(zip(layout.names, layout.settings, strict=True))
    for name, estimate in fit.parameters.items():
        lowest = settings[name].lowest
        low, high = estimate.interval_95
        if not np.isfinite(lowest) or (low > lowest and np.isfinite(high)):
            continue
        if low <= lowest < high < np.inf:
            yield Objection(
                "not determined",
                f"{name} lies between {low:.4g} and {high:.4g} {estimate.unit}, and may be "
                f"{lowest:g}.",
                "Record longer, and excite it more strongly.",
                NOT_IDENTIFIABLE,
            )
        else:
            yield Objection(
                "impossible value",
                f"{name} = {estimate.value:.4g} {estimate.unit} ({low:.4g} to {high:.4g}) is not "
                f"shown to be above {lowest:g}.",
                "Check signs, units and timing of the channels (penode check), or record longer "
                "and with larger currents.",
            )


def recordings_trained_on(
    fit: Fit, experiments: Sequence[Experiment]
) -> Iterator[tuple[Comparison, list[Comparison], list[Experiment]]]:
    """Yield each recording as one, and its stretches: predictions, and what was recorded.

    Checks judge a recording, not a stretch of it, which may be short, or at rest.
    """
    pairs = list(trained_on(fit, experiments))
    beside = {id(comparison): experiment for comparison, experiment in pairs}
    for stretches in stretches_of([comparison for comparison, _ in pairs]):
        yield together(stretches), stretches, [beside[id(one)] for one in stretches]


def unexplained(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where free runs explode, or explain nothing of what was recorded."""
    for whole, stretches, recorded in recordings_trained_on(fit, experiments):
        raised = [one for one in (_unexplained(c, whole) for c in stretches) if one]
        if raised and not unpredictable(fit, whole.measured.std(axis=0), recorded):
            yield sorted(raised, key=lambda one: one.name)[0]


def _unexplained(comparison: Comparison, whole: Comparison) -> Objection | None:
    """Return what speaks against one free run, errors beside what the whole recording moves."""
    free, ahead = (
        np.array(list(errors.values()))
        for errors in (comparison.free_run_errors, comparison.one_step_errors)
    )
    spread = np.maximum(comparison.measured.std(axis=0), whole.measured.std(axis=0))
    bad = ~(free <= _EXPLAINED * spread) & _moving(whole)
    far = bad & ~(free <= _FAR * ahead)
    states = ", ".join(np.array(comparison.states)[far if far.any() else bad])
    repair = "Look for a broken convention (penode check) or a channel from another recording."
    if far.any():
        reason = (
            f"{comparison.name}: the free run of {states} errs by more than half of what it "
            "moves, far more than single steps do."
        )
        return Objection("free run fails", reason, repair)
    if bad.any() and bad[_moving(whole)].all():
        reason = (
            f"{comparison.name}: the inputs explain less than three quarters of the variance "
            f"of {states}."
        )
        return Objection("nothing explained", reason, repair)
    return None


def few_samples_decide(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where isolated samples hold most of the squared one-step error."""
    for whole, stretches, recorded in recordings_trained_on(fit, experiments):
        residual = np.concatenate([finite_residual(one) for one in stretches])
        if len(residual) < 1 / _FEW:
            continue
        squares = (residual / _typical(residual)) ** 2
        if not squares.any():
            continue
        worst = np.argsort(squares.max(axis=1))[::-1][: int(_FEW * len(squares))]
        held = squares[worst].sum() / squares.sum()
        row = int(worst[0])
        column = int(np.argmax(squares[row]))
        far = abs(residual[row, column]) > _VISIBLE * whole.measured[:, column].std()
        if held > _MOST and far and squares[row, column] > _ASIDE**2:
            rows = np.concatenate([e.place.row + np.arange(2, len(e) + 1) for e in recorded])
            yield Objection(
                "outliers",
                f"{whole.name}: {len(worst)} of {len(squares)} samples hold "
                f"{100 * held:.0f} % of the squared one-step error, most of all channel "
                f"{whole.states[column]} at data row {rows[row]}.",
                "Cut them out, or record again.",
            )


def dependent_residual(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where inputs, states or time explain much of the one-step residual."""
    for whole, stretches, recorded in recordings_trained_on(fit, experiments):
        residual = np.concatenate([finite_residual(one) for one in stretches])
        names = (*whole.states, *fit.model.inputs)
        if len(residual) < _SAMPLES * (len(names) + 2):
            continue
        time = [e.place.start / e.time_step + np.arange(len(e) - 1.0) for e in recorded]
        columns = {"time": np.concatenate(time)}
        for name in (n for n in names if n in recorded[0].channels):
            columns[name] = np.concatenate([e.channels[name][:-1] for e in recorded])
        moving = {n: c - c.mean() for n, c in columns.items() if np.ptp(c) > 0}
        spread, moves = whole.measured.std(axis=0), _moving(whole)
        for k, row in enumerate((residual - residual.mean(axis=0)).T):
            state = whole.states[k]
            explained = {n: _share(row, c) for n, c in moving.items()}
            name = max(explained, key=lambda n: explained[n])
            astray = moves[k] and not whole.free_run_errors[state] < _SMALL * spread[k]
            if astray and explained[name] > _LEFT_OVER:
                yield Objection(
                    "dependent residual",
                    f"{whole.name}: {name} explains {100 * explained[name]:.0f} % of the "
                    f"one-step residual of {state}.",
                    "A term is missing in the model, or a channel is scaled or timed wrongly "
                    "(penode check).",
                )


def _moving(comparison: Comparison) -> BoolArray:
    """Return which states move, (state,): others are at rest beside one of the same unit."""
    spread, units = comparison.measured.std(axis=0), np.array(comparison.units)
    largest = np.array([spread[units == unit].max() for unit in units])
    return np.asarray(spread > _AT_REST * largest)


def _share(residual: FloatArray, column: FloatArray) -> float:
    """Return the squared correlation of two series of mean zero."""
    scaled = residual / max(float(np.abs(residual).max()), 1 / HUGE)
    whole = float(scaled @ scaled) * float(column @ column)
    return float(scaled @ column) ** 2 / max(whole, 1e-300)


def _typical(residual: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.median(np.abs(residual), axis=0) / 0.6745, 1 / HUGE))


#: What every fit is examined for, the gravest first.
CHECKS: tuple[Check, ...] = (
    few_samples_decide,
    unexplained,
    validation_fails,
    impossible_values,
    dependent_residual,
)


def checks_of(plan: Plan) -> tuple[Check, ...]:
    """Return what a fit of a plan is examined for: outliers only where squares were summed."""
    tempered = plan.loss.noise is not None
    return tuple(one for one in CHECKS if not (tempered and one is few_samples_decide))
