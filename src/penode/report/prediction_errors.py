"""Prediction errors in words: one number where all states share a unit, else one a state."""

from collections.abc import Mapping, Sequence

import numpy as np

from penode.report.document import KeyValue
from penode.report.quantities import number
from penode.validation.comparison import Comparison

_SPACE = "\N{NO-BREAK SPACE}"


def one_step_text(comparison: Comparison) -> str:
    """Return the one-step root mean square with its unit, ``"current 0.41 A, speed 2.0 rad/s"``.

    A dash stands where a state is neither measured nor guessed.
    """
    if not _predicted(comparison):
        return "–"
    return _text(comparison, comparison.one_step_rmse, comparison.one_step_errors)


def free_run_text(comparison: Comparison) -> str:
    """Return the free-run error as `one_step_text` does; ``"diverged"`` after a divergence."""
    if comparison.diverged:
        return "diverged"
    return _text(comparison, comparison.free_run_rmse, comparison.free_run_errors)


def relative_free_run(comparison: Comparison) -> float:
    """Return the free-run error over the largest value, of the worst state where units differ.

    Infinite after a divergence.
    """
    return _relative(comparison, comparison.free_run_rmse, comparison.free_run_errors)


def free_run_value(comparisons: Sequence[Comparison]) -> KeyValue | None:
    """Return the worst free run, on recordings not used for training where there are any."""
    unseen = [one for one in comparisons if one.role == "validation"]
    chosen = unseen or list(comparisons)
    if not chosen:
        return None
    worst = max(chosen, key=relative_free_run)
    kind = "not used for training" if unseen else "used for training"
    some = f"worst of {len(chosen)} recordings {kind}" if len(chosen) > 1 else f"recording {kind}"
    if worst.diverged:
        return KeyValue("Free run, rms error", "diverged", f"{worst.name}, {some}", doubtful=True)
    percent = number(100 * relative_free_run(worst), 2)
    detail = f"{percent}{_SPACE}% of the largest value; {some}"
    value = worst.free_run_rmse if worst.unit is not None else None
    return KeyValue("Free run, rms error", free_run_text(worst), detail, value)


def one_step_value(comparisons: Sequence[Comparison]) -> KeyValue | None:
    """Return the largest one-step error; None where no recording is predicted one step ahead."""
    predicted = [one for one in comparisons if _predicted(one)]
    if not predicted:
        return None
    if predicted[0].unit is not None:
        worst = max(predicted, key=lambda one: one.one_step_rmse)
    else:
        worst = max(predicted, key=lambda one: _relative(one, np.nan, one.one_step_errors))
    value = worst.one_step_rmse if worst.unit is not None else None
    detail = "root mean square, worst recording"
    return KeyValue("One step ahead", one_step_text(worst), detail, value)


def _predicted(comparison: Comparison) -> bool:
    return bool(np.isfinite(list(comparison.one_step_errors.values())).all())


def _text(comparison: Comparison, pooled: float, errors: Mapping[str, float]) -> str:
    if comparison.unit is not None:
        return _with(pooled, comparison.unit)
    pairs = zip(errors.items(), comparison.units, strict=True)
    return ", ".join(f"{name}{_SPACE}{_with(error, unit)}" for (name, error), unit in pairs)


def _with(error: float, unit: str) -> str:
    return f"{number(error)}{_SPACE}{unit}".rstrip()


def _relative(comparison: Comparison, pooled: float, errors: Mapping[str, float]) -> float:
    """Return an error over the largest value: pooled, or the worst state's."""
    if comparison.unit is not None:
        size = float(np.sqrt(np.sum(comparison.measured**2, axis=1)).max())
        return pooled / (size or 1.0)
    largest = np.abs(comparison.measured).max(axis=0)
    return float(np.max(np.array(list(errors.values())) / np.where(largest > 0, largest, 1.0)))
