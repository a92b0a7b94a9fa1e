"""Sentences that say what a fit's numbers mean: verdicts, headings, titles of figures."""

import math
from collections.abc import Sequence

import numpy as np

from penode.fit.fit import Estimate, Fit, HorizonChoice
from penode.fit.outcome import NORMAL_95
from penode.report.document import KeyValue, Notice
from penode.report.quantities import Scale, decimals_for, fixed, number, scale_for, with_unit
from penode.validation.comparison import Comparison
from penode.validation.residual_tests import Spectrum

_SPACE = "\N{NO-BREAK SPACE}"
_MEANINGS = {
    "plateau": "The estimate no longer depends on how far ahead the model predicts.",
    "H = 1 suffices": "The estimate is the same whether the model predicts one sample ahead or "
    "many, so the shortest horizon is enough.",
    "predicts best": "Nothing here tests whether the parameters depend on the horizon; identify "
    "for the purpose of parameters to find out.",
    "fixed": "The horizon was given, so nothing here tests whether the estimate depends on it. "
    "Identify with the horizon chosen automatically to find out.",
    "stopped": "What the horizons finished until then say is below; longer ones may change it. Go "
    "on with --resume to find out.",
    "no plateau": "The estimate keeps changing with how far ahead the model predicts. No horizon "
    "can be preferred, so the value below must not be used.",
    "not identifiable": "Different parameter values explain these recordings equally well, so "
    "the value below must not be used.",
}


def estimate_text(estimate: Estimate) -> tuple[str, str]:
    """Put an estimate into words.

    Parameters
    ----------
    estimate : Estimate
        What to tell.

    Returns
    -------
    value, interval : str
        Such as ``"10.02 mΩ"`` and ``"9.85 to 10.19 mΩ"``.
    """
    scale = scale_for([estimate.value], estimate.unit)
    decimals = decimals_for(estimate.std * scale.factor, estimate.value * scale.factor)
    value = f"{fixed(estimate.value * scale.factor, decimals)}{_SPACE}{scale.unit}".rstrip()
    return value, _span(estimate.interval_95, scale, decimals)


def range_text(values: Sequence[float], unit: str) -> str:
    """Return the lowest and the highest of some values with one unit.

    Parameters
    ----------
    values : sequence of float
        Values in ``unit``; not finite ones do not count.
    unit : str
        SI unit.

    Returns
    -------
    str
        Such as ``"5.1 to 41 mΩ"``; a dash where there is none.
    """
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return "–"
    low, high = float(finite.min()), float(finite.max())
    scale = scale_for([low, high], unit)
    decimals = decimals_for((high - low) * scale.factor / 10, high * scale.factor)
    return _span((low, high), scale, decimals)


def verdict_notice(choice: HorizonChoice) -> Notice:
    """Return the box that says whether the data could answer.

    Parameters
    ----------
    choice : HorizonChoice
        Selected horizon, verdict and reason.

    Returns
    -------
    Notice
        Red where the data cannot answer, amber where it was not tested, green otherwise.
    """
    meaning = _MEANINGS.get(choice.verdict, "")
    if choice.verdict == "stopped":
        return Notice("caution", "Stopped before the end", f"{choice.reason} {meaning}")
    if not choice.answered:
        label = f"The data cannot answer (verdict: {choice.verdict})"
        return Notice("refusal", label, f"{choice.reason} {meaning}".rstrip())
    untested = {
        "fixed": "Not tested: the horizon was given",
        "predicts best": "Not tested: the horizon was chosen for its predictions",
    }
    if choice.verdict in untested:
        return Notice("caution", untested[choice.verdict], f"{choice.reason} {meaning}")
    label = f"The data can answer (verdict: {choice.verdict})"
    return Notice("good", label, f"{meaning} {choice.reason}".lstrip())


def warning_notices(warnings: Sequence[str]) -> list[Notice]:
    """Return one amber box with all warnings, or none.

    Parameters
    ----------
    warnings : sequence of str
        One sentence each.

    Returns
    -------
    list of Notice
        At most one.
    """
    if not warnings:
        return []
    count = "One warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    return [Notice("caution", count, "Read before using the numbers.", tuple(warnings))]


def ladder_title(fit: Fit, name: str) -> str:
    """Say what a parameter does over the horizons.

    Parameters
    ----------
    fit : Fit
        Identification result.
    name : str
        One of ``fit.parameters``.

    Returns
    -------
    str
        Title of the figure.
    """
    choice = fit.horizon
    values = [rung.parameters.get(name, math.nan) for rung in choice.ladder]
    spread = range_text(values, fit.parameters[name].unit)
    if not choice.answered:
        return f"{choice.verdict.capitalize()}: {name} spans {spread} over the horizons"
    if len(choice.plateau) > 1 and _agrees(choice, name):
        low, high = min(choice.plateau), max(choice.plateau)
        return f"{name} is the same within its uncertainty from H = {low} to H = {high}"
    return f"{name} spans {spread} over {len(values)} horizons"


def _agrees(choice: HorizonChoice, name: str) -> bool:
    """Return whether all intervals of the plateau meet that of the selected horizon."""
    rungs = {rung.horizon: rung for rung in choice.ladder if name in rung.parameters}
    if choice.selected not in rungs:
        return False
    chosen = rungs[choice.selected]
    gaps = [
        abs(rungs[horizon].parameters[name] - chosen.parameters[name])
        <= NORMAL_95 * (rungs[horizon].std[name] + chosen.std[name])
        for horizon in choice.plateau
        if horizon in rungs
    ]
    return all(gaps)


def overlay_title(comparison: Comparison) -> str:
    """Say how well a recording is predicted.

    Parameters
    ----------
    comparison : Comparison
        One recording beside its predictions.

    Returns
    -------
    str
        Title of the figure.
    """
    seen = "not used for training" if comparison.role == "validation" else "used for training"
    name = f"{comparison.name} ({seen})"
    if not comparison.diverged:
        return f"{name}: the free run errs by {_free_run_text(comparison)} rms"
    broken = np.flatnonzero(~np.isfinite(comparison.free_run).all(axis=1))
    time = float(broken[0]) * comparison.time_step if broken.size else 0.0
    return f"{name}: the free run diverges after {with_unit(time, 's')}"


def spectrum_title(spectrum: Spectrum, lines: Sequence[tuple[float, str]] = ()) -> str:
    """Say where the largest residual lies.

    Parameters
    ----------
    spectrum : Spectrum
        Spectrum of the one-step residual.
    lines : sequence of (float, str)
        Frequencies in Hz that have a name, and the name.

    Returns
    -------
    str
        Title of the figure.
    """
    largest = np.nan_to_num(spectrum.amplitude, nan=0.0).max(axis=1)
    if len(largest) < 2 or not largest[1:].any():
        return "Nothing is left in the residual"
    frequency = float(spectrum.frequency[1 + int(largest[1:].argmax())])
    title = f"The largest residual lies at {with_unit(frequency, 'Hz')}"
    if not lines:
        return title
    width = 2.5 * float(spectrum.frequency[1] - spectrum.frequency[0])
    nearest, label = min(lines, key=lambda line: abs(line[0] - frequency))
    near = abs(nearest - frequency) <= max(width, 0.01 * nearest)
    return f"{title}, {label} the electrical frequency" if near else title


def free_run_value(comparisons: Sequence[Comparison]) -> KeyValue | None:
    """Return the worst free run, on recordings not used for training where there are any.

    Parameters
    ----------
    comparisons : sequence of Comparison
        Recordings beside their predictions.

    Returns
    -------
    KeyValue or None
        None where there is no recording.
    """
    unseen = [one for one in comparisons if one.role == "validation"]
    chosen = unseen or list(comparisons)
    if not chosen:
        return None
    worst = max(chosen, key=_relative_free_run)
    kind = "not used for training" if unseen else "used for training"
    some = f"worst of {len(chosen)} recordings {kind}" if len(chosen) > 1 else f"recording {kind}"
    if worst.diverged:
        return KeyValue("Free run, rms error", "diverged", f"{worst.name}, {some}", doubtful=True)
    share = number(100 * _relative_free_run(worst), 2)
    detail = f"{share}{_SPACE}% of the largest value; {some}"
    value = worst.free_run_rmse if worst.unit is not None else None
    return KeyValue("Free run, rms error", _free_run_text(worst), detail, value)


def _free_run_text(comparison: Comparison) -> str:
    """Return the free-run error: one figure where all states share a unit, else one a state."""
    if comparison.unit is not None:
        return f"{number(comparison.free_run_rmse)}{_SPACE}{comparison.unit}".rstrip()
    errors = zip(comparison.free_run_errors.items(), comparison.units, strict=True)
    return ", ".join(f"{name} {number(e)}{_SPACE}{unit}".rstrip() for (name, e), unit in errors)


def _relative_free_run(comparison: Comparison) -> float:
    """Return the free-run error over the largest value: pooled, or the worst state's."""
    largest = np.abs(comparison.measured).max(axis=0)
    if comparison.unit is not None:
        size = float(np.sqrt(np.sum(comparison.measured**2, axis=1)).max())
        return comparison.free_run_rmse / (size or 1.0)
    errors = np.array(list(comparison.free_run_errors.values()))
    return float(np.max(errors / np.where(largest > 0, largest, 1.0)))


def _span(bounds: tuple[float, float], scale: Scale, decimals: int) -> str:
    low, high = (fixed(bound * scale.factor, decimals) for bound in bounds)
    return f"{low} to {high}{_SPACE}{scale.unit}".rstrip()
