"""The report of a sweep: resistance, map, trust and drift over machines and dates on one page."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from penode.pmsm.sweep.fleet_sections import UNNAMED, Machine, flux_linkage_map, resistance
from penode.pmsm.sweep.fleet_trust import counted, tasks, trust, variants
from penode.report.document import Block, Document, KeyValue, KeyValues, Notice
from penode.report.html import render
from penode.report.quantities import with_unit

#: Verdicts under which the value was not tested.
_UNTESTED = {"fixed", "predicts best"}
_SPACE = "\N{NO-BREAK SPACE}"


def fleet_report(table: pl.DataFrame) -> str:
    """Return the report of a sweep, of one that goes on too, as one self-contained HTML page."""
    table = table.with_columns(pl.col("machine").fill_null(UNNAMED)).with_row_index("place")
    main = _main(table)
    sound = main.filter(pl.col("answered"))
    by_machine = main.group_by("machine", maintain_order=True)
    machines = [Machine(str(name), group) for (name,), group in by_machine]
    drifting = [one.name for one in machines if one.drifting]
    sections = [
        resistance(sound, machines),
        flux_linkage_map(sound, machines),
        trust(table),
        *variants(table),
        tasks(table),
    ]
    lead = (
        f"{counted(len(table), 'identification')} of "
        f"{counted(table['recording'].n_unique(), 'recording')}. {_shown(table, main)}"
    )
    title = _title(main, machines, drifting)
    return render(Document("Fleet", title, lead, _answer(table, main, drifting), sections))


def _main(table: pl.DataFrame) -> pl.DataFrame:
    """Return one row a recording: the first variant, its chosen or longest horizon, first seed."""
    first = table.filter(pl.col("variant").is_in(table["variant"].head(1).to_list()))
    far = pl.col("horizon").fill_null(np.iinfo(np.int64).max)
    chosen = first.sort(far, "seed", descending=[True, False], maintain_order=True)
    return chosen.unique("recording", keep="first", maintain_order=True).sort("place")


def _shown(table: pl.DataFrame, main: pl.DataFrame) -> str:
    if len(table) == len(main) or not len(main):
        return ""
    row = main.row(0, named=True)
    horizon = "the chosen horizon" if row["horizon"] is None else f"H = {row['horizon']}"
    named = f"the variant {row['variant']}, " if row["variant"] else ""
    return f"Machines and dates are compared by {named}{horizon} and seed {row['seed']}."


def _title(main: pl.DataFrame, machines: Sequence[Machine], drifting: Sequence[str]) -> str:
    answered = int(main["answered"].sum() or 0)
    title = f"{answered} of {counted(len(main), 'recording')} answered"
    if drifting:
        return f"{title}, {counted(len(drifting), 'machine')} of {len(machines)} drifting"
    return title


def _answer(table: pl.DataFrame, main: pl.DataFrame, drifting: Sequence[str]) -> list[Block]:
    notices: list[Block] = []
    if drifting:
        shown = ", ".join(drifting[:10]) + (" and others" if len(drifting) > 10 else "")
        text = f"The scatter of single recordings does not explain the change over dates: {shown}."
        notices.append(Notice("caution", "Drift", text))
    bad = table.filter(~pl.col("answered").fill_null(False))
    if len(bad):
        text = f"{len(bad)} of {len(table)} give no answer that may be used; see Trust."
        notices.append(Notice("caution", "Not answered", text))
    untested = set(table["verdict"].drop_nulls()) & _UNTESTED
    if untested:
        text = "Nothing tests whether R depends on the horizon where it was given; sweep with auto."
        notices.append(Notice("caution", "Not tested", text))
    if not notices:
        notices.append(Notice("good", "All answered", "Every recording gives an answer."))
    sound = main.filter(pl.col("answered"))
    return [
        *notices,
        KeyValues(
            (
                KeyValue("Recordings", str(len(main)), f"{main['machine'].n_unique()} machines"),
                _range(sound, "R", "ohm", "Resistance R"),
                _range(sound, "psi_d", "Vs", "Flux linkage psi_d"),
                KeyValue("Answered", f"{100 * len(sound) / max(len(main), 1):.0f}{_SPACE}%"),
            )
        ),
    ]


def _range(rows: pl.DataFrame, name: str, unit: str, label: str) -> KeyValue:
    values = rows[name].drop_nulls().drop_nans()
    if not len(values):
        return KeyValue(label, "no answer", "", doubtful=True)
    low, middle, high = (float(np.quantile(values, at)) for at in (0.05, 0.5, 0.95))
    detail = f"median; 90 % lie between {with_unit(low, unit, 4)} and {with_unit(high, unit, 4)}"
    return KeyValue(label, with_unit(middle, unit, 4), detail, middle)
