"""Sentences that say what a fit's numbers mean: verdicts, errors, titles of figures."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from penode.arrays import FloatArray
from penode.fit.fit import Estimate, Fit, HorizonChoice
from penode.fit.outcome import NORMAL_95
from penode.report.document import KeyValue, Notice
from penode.report.quantities import Scale, decimals_for, fixed, number, scale_for, with_unit
from penode.validation.comparison import Comparison
from penode.validation.residual_lines import Line, find_lines
from penode.validation.residual_tests import Spectrum

_SPACE = "\N{NO-BREAK SPACE}"
#: Ends of an interval so many times as large as its value do not choose the unit.
_FAR = 1e3
#: Frequencies below which there is no floor of noise to stand out of.
_FEWEST = 16
#: Width of a line over its frequency: where the speed varies a line is spread.
_SPREAD = 0.03
_MEANINGS = {
    "plateau": "The estimate no longer depends on how far ahead the model predicts.",
    "H = 1 suffices": "The estimate is the same whether the model predicts one sample ahead or "
    "many, so the shortest horizon is enough.",
    "operating points": "All points balance with one machine, each as well as without it.",
    "predicts best": "Nothing here tests whether the parameters depend on the horizon; identify "
    "for the purpose of parameters to find out.",
    "fixed": "The horizon was given, so nothing here tests whether the estimate depends on it. "
    "Identify with the horizon chosen automatically to find out.",
    "stopped": "What the horizons finished until then say is below; longer ones may change it. Go "
    "on with --resume to find out.",
    "no plateau": "The estimate keeps changing with how far ahead the model predicts. No horizon "
    "can be preferred, so its value must not be used.",
    "implausible": "The model cannot explain these recordings, so its value must not be "
    "used, however narrow its interval is.",
    "not identifiable": "These recordings do not determine it, so its value must not be used.",
}
#: Labels of verdicts under which the value was not tested.
_UNTESTED = {
    "stopped": "Stopped before the end",
    "fixed": "Not tested: the horizon was given",
    "predicts best": "Not tested: the horizon was chosen for its predictions",
}


def estimate_text(estimate: Estimate) -> tuple[str, str]:
    """Put an estimate into words, value and interval: ``"10.02 mΩ"``, ``"9.85 to 10.19 mΩ"``."""
    ends = np.abs(estimate.interval_95)
    near = ends[ends < _FAR * abs(estimate.value)]
    scale = scale_for([estimate.value, *near], estimate.unit)
    decimals = decimals_for(estimate.std * scale.factor, estimate.value * scale.factor)
    value = f"{fixed(estimate.value * scale.factor, decimals)}{_SPACE}{scale.unit}".rstrip()
    return value, _span(estimate.interval_95, scale, decimals)


def range_text(values: Sequence[float], unit: str) -> str:
    """Return the lowest and highest finite value with one unit, ``"5.1 to 41 mΩ"``, or a dash."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return "–"
    low, high = float(finite.min()), float(finite.max())
    scale = scale_for([low, high], unit)
    decimals = decimals_for((high - low) * scale.factor / 10, high * scale.factor)
    return _span((low, high), scale, decimals)


def verdict_notice(choice: HorizonChoice) -> Notice:
    """Return the box that says whether the data could answer: red, amber (not tested) or green."""
    verdict, reason = choice.verdict, choice.reason
    meaning = _MEANINGS.get(verdict, "")
    if verdict in _UNTESTED:
        return Notice("caution", _UNTESTED[verdict], f"{reason} {meaning}")
    if not choice.answered:
        label = f"The data cannot answer (verdict: {verdict})"
        return Notice("refusal", label, f"{reason} {meaning}".rstrip())
    label = f"The data can answer (verdict: {verdict})"
    return Notice("good", label, f"{meaning} {reason}".lstrip())


def warning_notices(warnings: Sequence[str]) -> list[Notice]:
    """Return one amber box with all warnings, or none."""
    if not warnings:
        return []
    count = "One warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    return [Notice("caution", count, "Read before using the numbers.", tuple(warnings))]


def ladder_title(fit: Fit, name: str) -> str:
    """Say what a parameter does over the horizons."""
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
    """Say how well a recording is predicted."""
    seen = "not used for training" if comparison.role == "validation" else "used for training"
    name = f"{comparison.name} ({seen})"
    if not comparison.diverged:
        return f"{name}, rms error of the free run: {free_run_text(comparison)}"
    broken = np.flatnonzero(~np.isfinite(comparison.free_run).all(axis=1))
    time = float(broken[0]) * comparison.time_step if broken.size else 0.0
    return f"{name}: the free run diverges after {with_unit(time, 's')}"


def spectrum_title(
    spectrum: Spectrum,
    states: Sequence[tuple[str, str]],
    lines: Sequence[tuple[float, str]] = (),
) -> str:
    """Say where the strongest line of the residual lies, of each state where their units differ.

    ``states`` are name and SI unit of each column; ``lines`` are frequencies in Hz with their
    names.
    """
    amplitude = np.nan_to_num(spectrum.amplitude, nan=0.0)[1:]
    if not amplitude.size or not amplitude.any():
        return "Nothing is left in the residual"
    frequency = spectrum.frequency[1:]
    enough = len(frequency) >= _FEWEST
    found = find_lines(frequency, amplitude**2) if enough else ()  # strongest of its state first
    if not found:
        return "No line stands out of the residual's noise"
    if len({unit for _, unit in states}) == 1:
        strongest = max(found, key=lambda line: line.amplitude)
        where = _place(strongest, frequency, lines)
        name = states[strongest.signal][0]
        return f"The strongest line of the residual lies in {name}, at {where}"
    first = {line.signal: line for line in reversed(found)}
    peaks = [
        f"{name} at {_place(first[signal], frequency, lines)}"
        for signal, (name, _) in enumerate(states)
        if signal in first
    ]
    return f"The strongest lines of the residual: {listed(peaks)}"


def _place(line: Line, frequencies: FloatArray, named: Sequence[tuple[float, str]]) -> str:
    """Return the frequency of a line, with the name of what is known to lie there."""
    shown = with_unit(line.frequency, "Hz")
    if not named:
        return shown
    width = 2.5 * float(frequencies[1] - frequencies[0])
    nearest, label = min(named, key=lambda one: abs(one[0] - line.frequency))
    near = abs(nearest - line.frequency) <= max(width, _SPREAD * nearest)
    return f"{shown}, {label}" if near else shown


def listed(words: Sequence[str]) -> str:
    """Return words as people list them: ``"a, b and c"``."""
    *first, last = words or ("nothing",)
    return f"{', '.join(first)} and {last}" if first else last


def _span(bounds: tuple[float, float], scale: Scale, decimals: int) -> str:
    low, high = (fixed(bound * scale.factor, decimals) for bound in bounds)
    return f"{low} to {high}{_SPACE}{scale.unit}".rstrip()


def errors_of(comparison: Comparison, free_run: bool) -> dict[str, tuple[float, str]]:
    """Return the error of each state and its unit; one without name where all share a unit."""
    if comparison.unit is not None:
        pooled = comparison.free_run_rmse if free_run else comparison.one_step_rmse
        return {"": (pooled, comparison.unit)}
    errors = comparison.free_run_errors if free_run else comparison.one_step_errors
    units = zip(errors.items(), comparison.units, strict=True)
    return {name: (error, unit) for (name, error), unit in units}


def one_step_text(comparison: Comparison) -> str:
    """Return the one-step root mean square with its unit, ``"current 0.41 A, speed 2.0 rad/s"``.

    A dash stands where a state is neither measured nor guessed.
    """
    return _text(errors_of(comparison, free_run=False)) if _predicted(comparison) else "–"


def free_run_text(comparison: Comparison) -> str:
    """Return the free-run error as `one_step_text` does; ``"diverged"`` after a divergence."""
    return "diverged" if comparison.diverged else _text(errors_of(comparison, free_run=True))


def relative_error(comparison: Comparison, free_run: bool = True) -> float:
    """Return an error over the largest value, of the worst state where units differ.

    Infinite after a divergence.
    """
    sizes = np.abs(comparison.measured).max(axis=0)
    if comparison.unit is not None:
        sizes = np.linalg.norm(comparison.measured, axis=1).max()
    errors = [error for error, _ in errors_of(comparison, free_run).values()]
    return float(np.max(np.array(errors) / np.where(sizes > 0, sizes, 1.0)))


def free_run_value(comparisons: Sequence[Comparison]) -> KeyValue | None:
    """Return the worst free run, on recordings not used for training where there are any."""
    unseen = [one for one in comparisons if one.role == "validation"]
    chosen = unseen or list(comparisons)
    if not chosen:
        return None
    worst = max(chosen, key=relative_error)
    kind = "not used for training" if unseen else "used for training"
    some = f"worst of {len(chosen)} recordings {kind}" if len(chosen) > 1 else f"recording {kind}"
    if worst.diverged:
        return KeyValue("Free run, rms error", "diverged", f"{worst.name}, {some}", doubtful=True)
    detail = f"{number(100 * relative_error(worst), 2)}{_SPACE}% of the largest value; {some}"
    value = worst.free_run_rmse if worst.unit is not None else None
    return KeyValue("Free run, rms error", free_run_text(worst), detail, value)


def one_step_value(comparisons: Sequence[Comparison]) -> KeyValue | None:
    """Return the largest one-step error; None where no recording is predicted one step ahead."""
    predicted = [one for one in comparisons if _predicted(one)]
    if not predicted:
        return None
    pooled = predicted[0].unit is not None
    worst = max(
        predicted, key=lambda one: one.one_step_rmse if pooled else relative_error(one, False)
    )
    value = worst.one_step_rmse if pooled else None
    detail = "root mean square from a noisy sample, worst recording"
    return KeyValue("One step ahead", one_step_text(worst), detail, value)


def _predicted(comparison: Comparison) -> bool:
    return bool(np.isfinite(list(comparison.one_step_errors.values())).all())


def _text(errors: Mapping[str, tuple[float, str]]) -> str:
    shown = (
        f"{name}{_SPACE}{number(error)}{_SPACE}{unit}" for name, (error, unit) in errors.items()
    )
    return ", ".join(one.strip() for one in shown)
