"""The uncertainty budget of a fit, in words and as a table with bars."""

from collections.abc import Sequence

import numpy as np

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95, Contribution, Estimate
from penode.report.document import Cell, Section, Table
from penode.report.quantities import Scale, number, scale_for
from penode.report.tables import Column, numeric, table

#: Fraction of the largest contribution below which one is not named in a sentence.
MINOR = 0.2
#: Fraction of the variance below which no figure is given.
_LEAST = 0.01


def uncertainty_budget(fit: Fit) -> Section | None:
    """Return the section on what the intervals are made of."""
    budgets = {name: one for name, one in fit.parameters.items() if one.budget}
    if not budgets:
        return None
    lead = "What the data show of the uncertainty by themselves"
    if any(_assumed(one) for one in budgets.values()):
        lead += (
            ", and what was assumed of the sensors, which no statistics of a recording can show. "
            "Give the accuracy of your own in the study file"
        )
    return Section(
        "Uncertainty budget",
        f"{lead}.",
        [_table(name, estimate) for name, estimate in budgets.items()],
    )


def budget_sentence(estimate: Estimate) -> str:
    """Return the main contributions to a half width; empty where none was assumed.

    In per cent, or in the parameter's own unit where zero is in the interval.
    """
    own = _assumed(estimate)
    if not own:
        return ""
    half = NORMAL_95 * estimate.std
    scale = Scale(100 / abs(estimate.value), "%") if half < abs(estimate.value) else None
    scale = scale or scale_for([half], estimate.unit)

    def width(std: float) -> str:
        return f"{number(NORMAL_95 * scale.factor * std, 2)} {scale.unit}".rstrip()

    def size(row: Contribution) -> str:
        return f"{'std ' if row.accuracy[:1].isdigit() else ''}{size_text(row)}"

    main = [row for row in own if row.std >= MINOR * estimate.budget[0].std]
    parts = [f"{row.source} {width(row.std)} ({size(row)})" for row in main]
    shown = f"the data alone {width(estimate.statistical_std)}"
    whole = f"half width {width(estimate.std)}"
    give = ""
    if any(row.origin == "assumed" for row in main):
        give = "; give what is assumed as it is of your own sensors, under [accuracy]"
    return f"{whole}: {', '.join([*parts, shown])}{give}"


def size_text(row: Contribution) -> str:
    """Return the size of a source and where it is from."""
    return f"{row.accuracy} {row.origin}".rstrip()


def _assumed(estimate: Estimate) -> list[Contribution]:
    return [row for row in estimate.budget if row.accuracy]


def _table(name: str, estimate: Estimate) -> Table:
    scale = scale_for([row.std for row in estimate.budget], estimate.unit)
    shown = [row for row in estimate.budget if row.std > 0]
    fractions = _fractions([row.std for row in shown])
    columns: list[Column] = [
        ("source", [row.source for row in shown]),
        ("its standard deviation", [size_text(row) or "from the data" for row in shown]),
        (
            f"contribution to {name} in {scale.unit}".rstrip(),
            [numeric(number(row.std * scale.factor, 2), row.std) for row in shown],
        ),
        ("of the variance", [_bar(fraction) for fraction in fractions]),
        ("what would make it smaller", [row.remedy for row in shown]),
    ]
    caption = (
        "Contributions are standard deviations; their squares add (JCGM 100:2008). The 95 % "
        f"interval is the value ± {NORMAL_95} times their root sum of squares. Of the sensors, "
        "declared stands in the study file, assumed is that of an ordinary bench, and estimated "
        "is what the recordings show, where that is less; what they showed to be off was corrected "
        "and stands in the provenance, under structure."
    )
    return table(f"Standard uncertainty of {name}", columns, caption)


def _fractions(deviations: Sequence[float]) -> FloatArray:
    """Return each one's fraction of the variance; unbounded ones have all of it."""
    squares = np.square(deviations)
    unbounded = np.isinf(squares)
    squares = unbounded.astype(np.float64) if unbounded.any() else squares
    return np.asarray(squares / squares.sum())


def _bar(fraction: float) -> Cell:
    text = f"{100 * fraction:.0f} %" if fraction >= _LEAST else f"< {100 * _LEAST:.0f} %"
    return Cell(text, fraction, "bar")
