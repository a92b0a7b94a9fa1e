"""A fit in a few lines of text, and as a small table for notebooks."""

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from penode.validation.comparison import Comparison, StationaryComparison

if TYPE_CHECKING:
    from penode.fit.fit import Fit


def text(fit: "Fit") -> str:
    """Return a fit's parameters, horizon and errors as lines of text."""
    rows = [
        (name, value, f"95 % {interval}", rho and f"identifiability {rho}")
        for name, value, interval, rho in _parameters(fit)
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)] if rows else []
    lines = [
        "  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    lines += [f"  {_where(c)}: {_errors(c)}" for c in fit.recordings]
    if fit.stationary is not None:
        lines.append(f"  {fit.stationary.name} (points): {_at_rest(fit.stationary)}")
    lines += [f"  Warning: {warning}" for warning in fit.warnings]
    return "\n".join([f"Fit of {type(fit.model).__name__}: {_horizon(fit)}", *lines])


def html(fit: "Fit") -> str:
    """Return the same as HTML: a table of parameters and one of recordings."""
    head = f"<b>{escape(type(fit.model).__name__)}</b>: {escape(_horizon(fit))}"
    parameters = _table(
        ("parameter", "value", "95 % interval", "identifiability"), _parameters(fit)
    )
    recordings = _table(
        ("recording", "rms error"), [(_where(c), _errors(c)) for c in fit.recordings]
    )
    warnings = "".join(f"<p>Warning: {escape(w)}</p>" for w in fit.warnings)
    return f"<p>{head}</p>{parameters}{recordings}{warnings}"


def _horizon(fit: "Fit") -> str:
    choice = fit.horizon
    return f"H = {choice.selected}, {choice.verdict}. {choice.reason}".rstrip()


def _parameters(fit: "Fit") -> list[tuple[str, ...]]:
    """Return name, value with unit, interval, and identifiability where it is known, as text."""
    return [
        (
            name,
            f"{_number(one.value, one.std)} {one.unit}",
            " to ".join(_number(end, one.std) for end in one.interval_95),
            "" if one.identifiability is None else f"{one.identifiability:.2g}",
        )
        for name, one in fit.parameters.items()
    ]


def _number(value: float, std: float) -> str:
    """Return a value to the second digit of its deviation, three digits at least."""
    size, digits = abs(value), 4
    if 0 < std < math.inf and 0 < size < math.inf:
        digits = math.floor(math.log10(size)) - math.floor(math.log10(std)) + 2
    return f"{value:#.{min(max(digits, 3), 12)}g}".rstrip(".")


def _where(comparison: Comparison) -> str:
    return f"{comparison.name} ({comparison.role})"


def _at_rest(points: StationaryComparison) -> str:
    """Return the errors at points in words."""
    return ", ".join(
        f"{name} {one['rmse']:.3g} {one['unit']}, without the point {one['rmse_without']:.3g}"
        for name, one in points.metrics().items()
    )


def _errors(comparison: Comparison) -> str:
    """Return the errors in words: of all states where they share a unit, else of each.

    Without the states there is nothing to predict a single step from.
    """
    if comparison.unit is not None:
        pairs = [("", comparison.one_step_rmse, comparison.free_run_rmse, comparison.unit)]
    else:
        one, run = comparison.one_step_errors, comparison.free_run_errors
        pairs = [
            (f"{name} ", one[name], run[name], unit)
            for name, unit in zip(comparison.states, comparison.units, strict=True)
        ]
    known = bool(np.isfinite(comparison.one_step[1:]).any())
    return ", ".join(
        (f"{n}one step {a:.3g} {u}, free run " if known else f"{n}free run ") + f"{b:.3g} {u}"
        for n, a, b, u in pairs
    )


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    lines = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"
