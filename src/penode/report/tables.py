"""Tables any identification has: parameters, ladder, validation, provenance."""

import math
from collections.abc import Mapping, Sequence
from string import ascii_lowercase
from typing import Any, TypeAlias

from penode.fit.fit import Estimate, Fit, HorizonChoice
from penode.report.document import Cell, Row, Table
from penode.report.quantities import (
    decimals_for,
    fixed,
    labelled,
    number,
    scale_for,
    with_deviation,
)
from penode.report.statements import errors_of
from penode.validation.comparison import Comparison

_SPACE = "\N{NO-BREAK SPACE}"
_ROLES = {"train": "training", "validation": "validation"}
#: Head and cells of a column; a cell of words alone is its text.
Column: TypeAlias = tuple[str, Sequence[Cell | str]]


def table(
    title: str, columns: Sequence[Column], caption: str = "", marks: Sequence[str] = ()
) -> Table:
    """Return a table from its columns; ``marks`` stand beside the first cell of each row."""
    cells = [[Cell(one) if isinstance(one, str) else one for one in own] for _, own in columns]
    rows = list(zip(*cells, strict=True))
    marked = zip(rows, marks or [""] * len(rows), strict=True)
    return Table(
        title, tuple(head for head, _ in columns), tuple(Row(*row) for row in marked), caption
    )


def numeric(text: str, value: float | None = None) -> Cell:
    """Return a cell of a number, and what it stands for in SI units."""
    known = value is not None and not math.isnan(value)
    return Cell(text, value if known else None, "number")


def plain(value: float | None, digits: int = 3) -> Cell:
    """Return a cell of a number that is shown as it is, a dash for none."""
    return numeric(number(value, digits), value)


def parameter_table(fit: Fit) -> Table:
    """Tabulate the physical parameters, with their identifiability where it was computed."""
    rows = [_parameter_cells(name, estimate) for name, estimate in fit.parameters.items()]
    heads = ("parameter", "value", "standard deviation", "95 % interval", "unit")
    columns: list[Column] = [*zip(heads, zip(*rows, strict=True), strict=True)]
    caption = (
        "The standard deviation allows for residuals that are correlated in time and for the "
        "spread over the horizons that agree, and for the sensors, whose accuracy is given or "
        "assumed."
        if fit.horizon.ladder
        else "The standard deviation allows for everything that the uncertainty budget names."
    )
    independence = [one.identifiability for one in fit.parameters.values()]
    if any(one is not None for one in independence):
        columns.append(("identifiability", [plain(one, 2) for one in independence]))
        caption += (
            " Identifiability is 1 where nothing in the learned map can imitate the parameter, and "
            "0 where the data cannot distinguish the two: below 0.01 it is said to be not "
            "identifiable; above that a small value widens the interval, which allows for it."
        )
    if not fit.horizon.answered:
        caption = f"For diagnosis only; the data cannot answer. {caption}"
    return table("Physical parameters", columns, caption)


def correlation_table(fit: Fit) -> Table:
    """Tabulate how the errors of the physical parameters go together."""
    names = tuple(fit.parameters)
    columns: list[Column] = [("parameter", names)]
    columns += [
        (name, [numeric(fixed(one, 2), one) for one in column])
        for name, column in zip(names, fit.correlation.T.tolist(), strict=True)
    ]
    caption = (
        "Correlations of the errors that the deviations above are of, all rows of the budget "
        "included. A dash: not known."
    )
    return table("Correlations of the parameters", columns, caption)


def _parameter_cells(name: str, estimate: Estimate) -> tuple[Cell | str, ...]:
    scale = scale_for([estimate.value], estimate.unit)
    value, std = _scaled(estimate.value, estimate.std, scale.factor)
    decimals = decimals_for(estimate.std * scale.factor, estimate.value * scale.factor)
    bounded = any(map(math.isfinite, estimate.interval_95))
    ends = (fixed(bound * scale.factor, decimals) for bound in estimate.interval_95)
    interval = numeric(" to ".join(ends) if bounded else "unbounded")
    label = f"{name}, {estimate.meaning}" if estimate.meaning else name
    return label, value, std, interval, scale.unit or "1"


def ladder_table(
    choice: HorizonChoice, units: Mapping[str, str], states: Sequence[tuple[str, str]]
) -> Table:
    """Tabulate every horizon tried, the selected one and its plateau marked.

    ``units`` says which parameters, in order; ``states`` are name and SI unit of each measured
    state. The free-run error has one column, or one a state where their units differ.
    """
    ladder = choice.ladder
    columns: list[Column] = [("horizon H", [_count(rung.horizon) for rung in ladder])]
    for name, unit in units.items():
        values, stds = (
            [part.get(name, math.nan) for part in parts]
            for parts in ([r.parameters for r in ladder], [r.std for r in ladder])
        )
        scale = scale_for(values, unit)
        shown = [_scaled(*both, scale.factor) for both in zip(values, stds, strict=True)]
        columns.append((labelled(name, scale.unit, _SPACE), [value for value, _ in shown]))
        columns.append(("± std", [std for _, std in shown]))
    shared = len({unit for _, unit in states}) < 2
    caption = (
        "Errors are root mean squares over the training recordings. Where the state at the start "
        "of a window is estimated, an error over one step holds less noise than a prediction from "
        "a sample. "
    )
    if shared:
        unit = states[0][1] if states else ""
        head = labelled("H-step rmse", unit, _SPACE)
        free_runs = [{"": (rung.free_run_rmse, unit)} for rung in ladder]
    else:
        head = "H-step rmse, scaled"
        caption += "The H-step error counts each state in the scale that the loss gives it. "
        free_runs = [{s: (rung.free_run_errors.get(s), u) for s, u in states} for rung in ladder]
    outcomes = list(dict.fromkeys(rung.outcome for rung in ladder))
    more = map(str, range(len(ascii_lowercase) + 1, len(outcomes) + 1))
    letters = dict(zip(outcomes, [*ascii_lowercase, *more], strict=False))
    columns += [
        (head, [plain(rung.rmse) for rung in ladder]),
        *_error_columns("free-run rmse", free_runs, "diverged"),
        ("iterations", [_count(rung.iterations) for rung in ladder]),
        ("outcome", [letters[rung.outcome] for rung in ladder]),
    ]
    if any(not math.isfinite(std) for rung in ladder for std in rung.std.values()):
        caption += (
            "Without an interval (∞), as where its predictions go astray, a horizon has no weight. "
        )
    ends = " ".join(f"{letter}: {outcome}" for outcome, letter in letters.items())
    marks = [_mark(rung.horizon, choice) for rung in ladder]
    title = "Estimates and errors at each horizon"
    return table(title, columns, f"{caption}The optimiser's outcome: {ends}", marks)


def validation_table(comparisons: Sequence[Comparison]) -> Table:
    """Tabulate errors per recording, each in one column, or one a state where units differ."""
    columns: list[Column] = [
        ("recording", [one.name for one in comparisons]),
        ("used for", [_ROLES.get(one.role, one.role) for one in comparisons]),
        (f"duration in{_SPACE}s", [plain(len(c.measured) * c.time_step) for c in comparisons]),
    ]
    for name, free_run, otherwise in (
        ("one-step rmse", False, "–"),
        ("free-run rmse", True, "diverged"),
    ):
        errors = [errors_of(one, free_run) for one in comparisons]
        columns += _error_columns(name, errors, otherwise)
    caption = (
        "One step: every sample predicted from what was measured before it. Free run: the whole "
        "recording, or each stretch of it, predicted from its first sample alone."
    )
    return table("Prediction errors", columns, caption)


def measured_states(comparisons: Sequence[Comparison]) -> tuple[tuple[str, str], ...]:
    """Return name and SI unit of each measured state of recordings of the same states."""
    if not comparisons:
        return ()
    return tuple(zip(comparisons[0].states, comparisons[0].units, strict=True))


def provenance_table(provenance: Mapping[str, Any]) -> Table:
    """Tabulate where the result came from; entries may be nested."""
    entries = [[Cell(text, kind="code") for text in one] for one in _flat(provenance, "")]
    names, texts = zip(*entries, strict=True) if entries else ((), ())
    return table("Versions, data and settings", [("entry", names), ("value", texts)])


def _count(number_of: int) -> Cell:
    return numeric(str(number_of), number_of)


def _scaled(value: float, std: float, factor: float) -> tuple[Cell, Cell]:
    """Return value and deviation with the digits that the deviation leaves; dashes for no value."""
    texts = with_deviation(value * factor, std * factor)
    return numeric(texts[0], value), numeric(texts[1], std)


def _mark(horizon: int, choice: HorizonChoice) -> str:
    if horizon == choice.selected:
        return "selected"
    return "plateau" if choice.answered and horizon in choice.plateau else ""


def _error_columns(
    name: str, errors: Sequence[Mapping[str, tuple[float | None, str]]], otherwise: str
) -> list[Column]:
    """Return a column of errors a state; ``otherwise`` stands for what is not finite."""
    columns: list[Column] = []
    for state in errors[0] if errors else ():
        found = [row[state] for row in errors]
        cells = [
            numeric(otherwise) if one is None or not math.isfinite(one) else plain(one)
            for one, _ in found
        ]
        columns.append(
            (labelled(f"{name} of {state}" if state else name, found[0][1], _SPACE), cells)
        )
    return columns


def _flat(content: Any, name: str) -> list[tuple[str, str]]:
    """Return every entry of nested mappings and lists with the path that leads to it."""
    if isinstance(content, Mapping) and content:
        items = [(f"{name}.{key}" if name else str(key), item) for key, item in content.items()]
        return [row for path, item in items for row in _flat(item, path)]
    if isinstance(content, (list, tuple)) and any(isinstance(item, Mapping) for item in content):
        return [row for k, item in enumerate(content) for row in _flat(item, f"{name}[{k}]")]
    if isinstance(content, (list, tuple)):
        entries = [_entry(one) for one in content]
        sentences = all(one.endswith(".") for one in entries)
        return [(name, (" " if sentences else ", ").join(entries))]
    return [(name, _entry(content))]


def _entry(content: Any) -> str:
    return f"{content:.6g}" if isinstance(content, float) else str(content)
