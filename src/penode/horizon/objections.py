"""Objections: what makes a result implausible however narrow its intervals are.

An interval covers the truth only where the model can explain the recording. Each check here looks
at a finished fit for one sign that it cannot, and gives the reason and the cheapest mend.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.left_out import left_out
from penode.fit.outcome import IMPLAUSIBLE, Objection
from penode.models.layout import Layout
from penode.validation.comparison import Comparison

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
#: A residual, and over a typical one: the sum of its squares is still a number.
_HUGE = 1e60
#: Each channel that may explain a residual needs so many samples.
_SAMPLES = 50


def objections(
    fit: Fit, experiments: Sequence[Experiment], checks: Sequence[Check]
) -> tuple[Objection, ...]:
    """Return what all checks find.

    Parameters
    ----------
    fit : Fit
    experiments : sequence of Experiment
        What it was trained on, in the order of its training comparisons.
    checks : sequence of Check
    """
    return tuple(objection for check in checks for objection in check(fit, experiments))


def guarded(check: Check, missed: list[str]) -> Check:
    """Return a check that is left out by name where it fails: what was trained stands without it.

    Parameters
    ----------
    check : Check
    missed : list of str
        Gets the sentence that names a check which fails.
    """

    def examine(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        try:
            yield from check(fit, experiments)
        except Exception as error:
            name = getattr(check, "__name__", "a convention").strip("_").replace("_", " ")
            missed.append(left_out(f"the check for {name}", error))

    return examine


def with_objections(fit: Fit, raised: Sequence[Objection]) -> Fit:
    """Return the fit with objections, which turn a verdict that it is right.

    Parameters
    ----------
    fit : Fit
    raised : sequence of Objection
        The first gives the reason, the others are warnings.
    """
    if not raised:
        return fit
    choice, others = replace(fit.horizon, objections=tuple(raised)), list(raised)
    if choice.answered and choice.verdict != "stopped":
        first = others.pop(0)
        reason = f"{first.name.capitalize()}: {first.reason} {first.repair}"
        choice = replace(choice, verdict=IMPLAUSIBLE, reason=reason)
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
        if np.isfinite(lowest) and not (low > lowest and np.isfinite(high)):
            yield Objection(
                "impossible value",
                f"{name} = {estimate.value:.4g} {estimate.unit} ({low:.4g} to {high:.4g}) is not "
                f"shown to be above {lowest:g}.",
                "Check signs, units and timing of the channels (penode check), or record longer "
                "and with larger currents.",
            )


def unexplained(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where free runs explode, or explain nothing of what was recorded."""
    for comparison, _ in trained_on(fit, experiments):
        free, ahead = (
            np.array(list(errors.values()))
            for errors in (comparison.free_run_errors, comparison.one_step_errors)
        )
        spread = comparison.measured.std(axis=0)
        bad = ~(free <= _EXPLAINED * spread) & _moving(comparison)
        far = bad & ~(free <= _FAR * ahead)
        states = ", ".join(np.array(comparison.states)[far if far.any() else bad])
        mend = "Look for a broken convention (penode check) or a channel from another recording."
        if far.any():
            yield Objection(
                "free run fails",
                f"{comparison.name}: the free run of {states} errs by more than half of what it "
                "moves, far more than single steps do.",
                mend,
            )
        elif bad.any() and bad[_moving(comparison)].all():
            yield Objection(
                "nothing explained",
                f"{comparison.name}: the inputs explain less than three quarters of the variance "
                f"of {states}.",
                mend,
            )


def few_samples_decide(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where isolated samples hold most of the squared one-step error."""
    for comparison, experiment in trained_on(fit, experiments):
        residual = finite_residual(comparison)
        if len(residual) < 1 / _FEW:
            continue
        squares = (residual / _typical(residual)) ** 2
        if not squares.any():
            continue
        worst = np.argsort(squares.max(axis=1))[::-1][: int(_FEW * len(squares))]
        held = squares[worst].sum() / squares.sum()
        row = int(worst[0])
        column = int(np.argmax(squares[row]))
        far = abs(residual[row, column]) > _VISIBLE * comparison.measured[:, column].std()
        if held > _MOST and far and squares[row, column] > _ASIDE**2:
            yield Objection(
                "outliers",
                f"{comparison.name}: {len(worst)} of {len(squares)} samples hold "
                f"{100 * held:.0f} % of the squared one-step error, most of all channel "
                f"{comparison.states[column]} at data row "
                f"{experiment.place.row + row + 2}.",
                "Cut them out, or record again.",
            )


def dependent_residual(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
    """Yield an objection where inputs, states or time explain much of the one-step residual."""
    for comparison, experiment in trained_on(fit, experiments):
        residual = finite_residual(comparison)
        names = (*comparison.states, *fit.model.inputs)
        count = len(residual)
        if count < _SAMPLES * (len(names) + 2):
            continue
        channels = {n: experiment.channels[n][:count] for n in names if n in experiment.channels}
        columns = {"time": np.arange(count, dtype=float), **channels}
        moving = {n: c - c.mean() for n, c in columns.items() if np.ptp(c) > 0}
        for state, row in zip(comparison.states, (residual - residual.mean(axis=0)).T, strict=True):
            explained = {n: _share(row, c) for n, c in moving.items()}
            name = max(explained, key=lambda n: explained[n])
            spread = comparison.measured[:, comparison.states.index(state)].std()
            moves = _moving(comparison)[comparison.states.index(state)]
            astray = moves and not comparison.free_run_errors[state] < _SMALL * spread
            if astray and explained[name] > _LEFT_OVER:
                yield Objection(
                    "dependent residual",
                    f"{comparison.name}: {name} explains {100 * explained[name]:.0f} % of the "
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
    whole = float(residual @ residual) * float(column @ column)
    return float(residual @ column) ** 2 / max(whole, 1e-300)


def finite_residual(comparison: Comparison) -> FloatArray:
    """Return one-step residuals, (time - 1, state), a diverged prediction as a huge one."""
    residual = np.nan_to_num(comparison.one_step_residual, posinf=_HUGE, neginf=-_HUGE)
    return np.asarray(np.clip(residual, -_HUGE, _HUGE))


def _typical(residual: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.median(np.abs(residual), axis=0) / 0.6745, 1 / _HUGE))


#: What every fit is examined for, the gravest first.
CHECKS: tuple[Check, ...] = (
    few_samples_decide,
    unexplained,
    impossible_values,
    dependent_residual,
)
