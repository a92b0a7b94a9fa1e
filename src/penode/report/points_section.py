"""The report's section on points at which nothing changes."""

import math

from penode.fit.fit import Fit
from penode.report.document import Section, Table
from penode.report.quantities import labelled, number
from penode.report.tables import numeric, plain, table
from penode.validation.comparison import StationaryComparison

#: Points that are listed, those farthest from what the others say.
_LISTED = 8


def points_balance(fit: Fit) -> Section | None:
    """Return the section on the points beside what the model says of them."""
    one = fit.stationary
    if one is None:
        return None
    metrics, names = one.metrics(), one.quantities
    errors = table(
        "Errors of the points",
        [
            ("quantity", list(names)),
            ("unit", list(one.units)),
            ("rms, fitted", [plain(metrics[name]["rmse"]) for name in names]),
            ("rms, without the point", [plain(metrics[name]["rmse_without"]) for name in names]),
            (
                "within 95 %",
                [numeric(f"{100 * metrics[n]['within_95']:.0f} %") for n in names],
            ),
        ],
        "Without the point: each is compared with a model fitted to all others.",
    )
    return Section(
        "Points against the model",
        "A model that is right leaves of every point what its noise leaves, whether the point was "
        "used or not.",
        [errors, _farthest(fit, one)],
    )


def _farthest(fit: Fit, one: StationaryComparison) -> Table:
    gap = one.measured - one.without
    size = abs(gap / one.deviation)
    order = size.max(axis=1).argsort()[::-1][:_LISTED]
    worst = size[order].argmax(axis=1)
    pairs = list(zip(order, worst, strict=True))
    joined = fit.comparisons and math.isnan(one.distance)
    where = zip(fit.model.states, fit.model.state_units, strict=True)
    return table(
        "Points farthest from what all others say",
        [
            # Of all rows; points that are joined to a fit may be some of them.
            *([] if joined else [("row", [numeric(str(k + 1)) for k in order])]),
            *[
                (labelled(name, unit), [plain(one.states[k, column]) for k in order])
                for column, (name, unit) in enumerate(where)
            ],
            ("quantity", [one.quantities[q] for _, q in pairs]),
            (
                "measured less expected",
                [numeric(f"{number(gap[k, q], 2)} {one.units[q]}") for k, q in pairs],
            ),
            ("in deviations", [plain(float(size[k, q]), 2) for k, q in pairs]),
        ],
        "Of some dozens of points one or two lie beyond 2 deviations by chance.",
    )
