"""Tables any identification has: parameters, ladder, validation, provenance."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from penode.fit.fit import Estimate, Fit, HorizonChoice, HorizonSummary
from penode.report.document import Cell, Row, Table
from penode.report.quantities import decimals_for, fixed, number, scale_for
from penode.validation.comparison import Comparison

_SPACE = "\N{NO-BREAK SPACE}"
_ROLES = {"train": "training", "validation": "validation"}


def parameter_table(fit: Fit) -> Table:
    """Tabulate the physical parameters, with their identifiability where it was computed."""
    columns = ["parameter", "value", "standard deviation", "95 % interval", "unit"]
    caption = (
        "The standard deviation allows for residuals that are correlated in time and for the "
        "spread over the horizons that agree, and for the sensors where their accuracy was given."
    )
    rows = [_parameter_row(name, estimate) for name, estimate in fit.parameters.items()]
    independence = [estimate.identifiability for estimate in fit.parameters.values()]
    if any(one is not None for one in independence):
        columns.append("identifiability")
        rows = [
            (*row, _number(number(one, 2), one))
            for row, one in zip(rows, independence, strict=True)
        ]
        caption += (
            " Identifiability is 1 where nothing in the learned map can imitate the parameter, and "
            "0 where the data cannot distinguish the two."
        )
    if not fit.horizon.answered:
        caption = f"For diagnosis only; the data cannot answer. {caption}"
    return Table("Physical parameters", tuple(columns), tuple(map(Row, rows)), caption)


def ladder_table(
    choice: HorizonChoice, units: Mapping[str, str], states: Sequence[tuple[str, str]]
) -> Table:
    """Tabulate every horizon tried, the selected one and its plateau marked.

    ``units`` says which parameters, in order; ``states`` are name and SI unit of each measured
    state. The free-run error has one column, or one a state where their units differ.
    """
    scales = {
        name: scale_for([rung.parameters.get(name, math.nan) for rung in choice.ladder], unit)
        for name, unit in units.items()
    }
    unit = _shared_unit(states)
    heads = [head for name, scale in scales.items() for head in (_in(name, scale.unit), "± std")]
    outcomes = list(dict.fromkeys(rung.outcome for rung in choice.ladder))
    columns = (
        "horizon H",
        *heads,
        "H-step rmse, scaled" if unit is None else _in("H-step rmse", unit),
        *_error_heads("free-run rmse", states),
        "iterations",
        "outcome",
    )
    rows = []
    for rung in choice.ladder:
        cells = [_number(str(rung.horizon), rung.horizon)]
        for name, scale in scales.items():
            cells += _estimate_cells(rung, name, scale.factor)
        cells += [_plain(rung.rmse), *_free_run_cells(rung, states)]
        cells += [
            _number(str(rung.iterations), rung.iterations),
            Cell(_letter(outcomes.index(rung.outcome))),
        ]
        rows.append(Row(tuple(cells), _mark(rung.horizon, choice)))
    ends = " ".join(f"{_letter(k)}: {outcome}" for k, outcome in enumerate(outcomes))
    caption = "Errors are root mean squares over the training recordings. "
    if unit is None:
        caption += "The H-step error counts each state in the scale that the loss gives it. "
    caption += "The optimiser's outcome: "
    return Table("Estimates and errors at each horizon", columns, tuple(rows), caption + ends)


def validation_table(comparisons: Sequence[Comparison]) -> Table:
    """Tabulate errors per recording, each in one column, or one a state where units differ."""
    states = measured_states(comparisons)
    columns = (
        "recording",
        "used for",
        f"duration in{_SPACE}s",
        *_error_heads("one-step rmse", states),
        *_error_heads("free-run rmse", states),
    )
    rows = tuple(
        Row(
            (
                Cell(comparison.name),
                Cell(_ROLES.get(comparison.role, comparison.role)),
                _plain(len(comparison.measured) * comparison.time_step),
                *(
                    _plain(error if math.isfinite(error) else None)
                    for error in _one_step(comparison)
                ),
                *(_free_run(error) for error in _free_runs(comparison)),
            )
        )
        for comparison in comparisons
    )
    caption = (
        "One step: every sample predicted from the measured one before it. Free run: the whole "
        "recording, or each stretch of it, predicted from its first sample alone."
    )
    return Table("Prediction errors", columns, rows, caption)


def measured_states(comparisons: Sequence[Comparison]) -> tuple[tuple[str, str], ...]:
    """Return name and SI unit of each measured state of recordings of the same states."""
    if not comparisons:
        return ()
    return tuple(zip(comparisons[0].states, comparisons[0].units, strict=True))


def provenance_table(provenance: Mapping[str, Any]) -> Table:
    """Tabulate where the result came from; entries may be nested."""
    rows = tuple(
        Row((Cell(name, kind="code"), Cell(text, kind="code")))
        for name, text in _flat(provenance, "")
    )
    return Table("Versions, data and settings", ("entry", "value"), rows)


def _parameter_row(name: str, estimate: Estimate) -> tuple[Cell, ...]:
    scale = scale_for([estimate.value], estimate.unit)
    value, std = estimate.value * scale.factor, estimate.std * scale.factor
    decimals = decimals_for(std, value)
    low, high = (bound * scale.factor for bound in estimate.interval_95)
    bounded = math.isfinite(low) or math.isfinite(high)
    interval = f"{fixed(low, decimals)} to {fixed(high, decimals)}" if bounded else "unbounded"
    return (
        Cell(f"{name}, {estimate.meaning}" if estimate.meaning else name),
        _number(fixed(value, decimals), estimate.value),
        _number(fixed(std, decimals), estimate.std),
        Cell(interval, kind="number"),
        Cell(scale.unit or "1"),
    )


def _estimate_cells(rung: HorizonSummary, name: str, factor: float) -> list[Cell]:
    if name not in rung.parameters:
        return [Cell("–", kind="number")] * 2
    value, std = rung.parameters[name], rung.std.get(name, math.nan)
    decimals = decimals_for(std * factor, value * factor)
    return [
        _number(fixed(value * factor, decimals), value),
        _number(fixed(std * factor, decimals), std),
    ]


def _letter(position: int) -> str:
    return "abcdefghijklmnopqrstuvwxyz"[position] if position < 26 else str(position + 1)


def _mark(horizon: int, choice: HorizonChoice) -> str:
    if horizon == choice.selected:
        return "selected"
    return "plateau" if choice.answered and horizon in choice.plateau else ""


def _free_run(rmse: float | None) -> Cell:
    if rmse is None or not math.isfinite(rmse):
        return Cell("diverged", kind="number")
    return _plain(rmse)


def _plain(value: float | None) -> Cell:
    return _number(number(value), value)


def _number(text: str, value: float | None) -> Cell:
    return Cell(text, value, "number")


def _shared_unit(states: Sequence[tuple[str, str]]) -> str | None:
    """Return the unit that all states share, ``""`` where there is none, None where they differ."""
    units = {unit for _, unit in states}
    return None if len(units) > 1 else "".join(units)


def _error_heads(name: str, states: Sequence[tuple[str, str]]) -> list[str]:
    unit = _shared_unit(states)
    if unit is None:
        return [_in(f"{name} of {state}", own) for state, own in states]
    return [_in(name, unit)]


def _in(name: str, unit: str) -> str:
    return f"{name} in{_SPACE}{unit}" if unit else name


def _one_step(comparison: Comparison) -> list[float]:
    if comparison.unit is not None:
        return [comparison.one_step_rmse]
    return list(comparison.one_step_errors.values())


def _free_runs(comparison: Comparison) -> list[float]:
    if comparison.unit is not None:
        return [comparison.free_run_rmse]
    return list(comparison.free_run_errors.values())


def _free_run_cells(rung: HorizonSummary, states: Sequence[tuple[str, str]]) -> list[Cell]:
    if _shared_unit(states) is not None:
        return [_free_run(rung.free_run_rmse)]
    return [_free_run(rung.free_run_errors.get(name)) for name, _ in states]


def _flat(content: Any, name: str) -> list[tuple[str, str]]:
    """Return every entry of nested mappings and lists with the path that leads to it."""
    if isinstance(content, Mapping) and content:
        items = [(f"{name}.{key}" if name else str(key), item) for key, item in content.items()]
        return [row for path, item in items for row in _flat(item, path)]
    if isinstance(content, (list, tuple)) and any(isinstance(item, Mapping) for item in content):
        return [row for k, item in enumerate(content) for row in _flat(item, f"{name}[{k}]")]
    if isinstance(content, (list, tuple)):
        return [(name, ", ".join(map(_entry, content)))]
    return [(name, _entry(content))]


def _entry(content: Any) -> str:
    return f"{content:.6g}" if isinstance(content, float) else str(content)
