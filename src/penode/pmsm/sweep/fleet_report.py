"""The report of a sweep: resistance, map, trust and drift over machines and dates on one page."""

from collections.abc import Callable, Sequence
from datetime import date

import numpy as np
import polars as pl

from penode.arrays import FloatArray
from penode.fit.outcome import NORMAL_95
from penode.pmsm.sweep.fleet_figures import SINGLED, over_dates, over_horizons
from penode.pmsm.sweep.task import ANSWERED
from penode.pmsm.sweep.trend import Trend, trend_of
from penode.report.document import (
    Block,
    Cell,
    Document,
    Figure,
    KeyValue,
    KeyValues,
    Notice,
    Row,
    Section,
    Table,
)
from penode.report.html import render
from penode.report.quantities import number, with_unit

#: Verdicts under which the value was not tested.
_UNTESTED = {"fixed", "predicts best"}
#: Machine of recordings whose names say none.
_UNNAMED = "not named"
#: Most rows of a table of the page; the sweep's own table has all.
_MOST = 60
_SPACE = "\N{NO-BREAK SPACE}"


def fleet_report(table: pl.DataFrame) -> str:
    """Return the report of a sweep, of one that goes on too, as one self-contained HTML page."""
    table = table.with_columns(pl.col("machine").fill_null(_UNNAMED)).with_row_index("place")
    main = _main(table)
    sound = main.filter(pl.col("answered"))
    by_machine = main.group_by("machine", maintain_order=True)
    machines = [_Machine(str(name), group) for (name,), group in by_machine]
    drifting = [one.name for one in machines if one.drifting]
    sections = [
        _resistance(sound, machines),
        _flux_linkage_map(sound, machines),
        _trust(table),
        *_variants(table),
        _tasks(table),
    ]
    lead = (
        f"{_counted(len(table), 'identification')} of "
        f"{_counted(table['recording'].n_unique(), 'recording')}. {_shown(table, main)}"
    )
    title = f"{len(sound)} of {_counted(len(main), 'recording')} answered"
    if drifting:
        title += f", {_counted(len(drifting), 'machine')} of {len(machines)} drifting"
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
    values = _numbers(rows, name)
    if not len(values):
        return KeyValue(label, "no answer", "", doubtful=True)
    low, middle, high = map(float, np.quantile(values, (0.05, 0.5, 0.95)))
    detail = f"median; 90 % lie between {with_unit(low, unit, 4)} and {with_unit(high, unit, 4)}"
    return KeyValue(label, with_unit(middle, unit, 4), detail, middle)


# --- sections ---------------------------------------------------------------------------------


class _Machine:
    """One machine of a fleet: its rows, those that give an answer, the drifts of R and of psi_d."""

    def __init__(self, name: str, rows: pl.DataFrame):
        self.name, self.rows = name, rows
        self.sound = rows.filter(pl.col("answered"))
        self.drifts = {quantity: self._drift(quantity) for quantity in ("R", "psi_d")}

    def _drift(self, quantity: str) -> Trend | None:
        rows = self.sound.filter(pl.col(quantity).is_finite() & pl.col("date").is_not_null())
        dates = [date.fromisoformat(text) for text in rows["date"].to_list()]
        return trend_of(dates, rows[quantity].to_numpy())

    @property
    def drifting(self) -> bool:
        """Whether one of them is more than scatter."""
        return any(drift is not None and drift.significant for drift in self.drifts.values())

    @property
    def span(self) -> str:
        """First and last date."""
        dates = self.rows["date"].drop_nulls()
        ends = dict.fromkeys((dates.min(), dates.max()))
        return " to ".join(str(end) for end in ends) if len(dates) else "–"

    def row(self, quantity: str, unit: str, before: Sequence[Cell], after: Sequence[Cell]) -> Row:
        """Return its row: name, ``before``, mean, spread, ``after``, and how a quantity drifts."""
        drift, values = self.drifts[quantity], _numbers(self.sound, quantity)
        mean = _mean(self.sound, quantity)
        spread = change = "–"
        if mean and len(values) > 1:
            spread = f"{number(100 * float(np.std(values, ddof=1)) / mean, 2)}{_SPACE}%"
        if drift is not None and drift.mean:
            slope, half = (100 * x / abs(drift.mean) for x in (drift.per_year, drift.half_95))
            change = f"{slope:+.2f} ± {half:.2f}{_SPACE}%".replace("-", "−")
        own = (_quantity(mean, unit, 4), _count(spread))
        mark = "drifts" if drift and drift.significant else ""
        return Row((Cell(self.name), *before, *own, *after, _count(change)), mark)


def _resistance(sound: pl.DataFrame, machines: Sequence[_Machine]) -> Section:
    """Return the section on R of the rows that give an answer."""
    rows = [
        m.row("R", "ohm", (Cell(m.span), _count(len(m.rows)), _count(len(m.sound))), ())
        for m in _listed_machines(machines)
    ]
    figure = Figure(
        _drift_title(machines, "R"),
        "R follows the winding's temperature by 0.39 % a kelvin (copper): compare "
        "recordings of one temperature, or identify the term temperature_resistance.",
        over_dates(sound, "R", "ohm", ("R_low", "R_high"), _singled(machines)),
    )
    table = Table(
        "Machines: R",
        ("machine", "dates", "recordings", "answered", "R", "spread", "change a year"),
        tuple(rows),
        "Spread: deviation from recording to recording. Change: a line through the answers with "
        "its 95 % interval, marked where the 99 % interval leaves zero out."
        f"{_cut(len(machines))}",
    )
    lead = "R of every recording that gives an answer, with its 95 % interval."
    return Section("Resistance", lead, [figure, table])


def _flux_linkage_map(sound: pl.DataFrame, machines: Sequence[_Machine]) -> Section:
    """Return the section on the map at one current."""
    lead = (
        "The flux-linkage map at the current that the study file names, zero by default; empty "
        "where a recording does not reach it."
    )
    if not len(_numbers(sound, "psi_d")):
        return Section("Flux-linkage map", f"{lead} No recording does.", [])
    psi, half = pl.col("psi_d"), NORMAL_95 * pl.col("psi_d_std")
    bands = sound.with_columns((psi - half).alias("psi_d_low"), (psi + half).alias("psi_d_high"))
    others = {"psi_q": "Vs", "l_dd": "H", "l_qq": "H"}
    rows = [
        m.row("psi_d", "Vs", (), [_quantity(_mean(m.sound, q), u) for q, u in others.items()])
        for m in _listed_machines(machines)
    ]
    figure = Figure(
        _drift_title(machines, "psi_d"),
        "A magnet loses about 0.1 % of its flux linkage a kelvin (NdFeB); what stays lower "
        "at the same temperature is demagnetisation.",
        over_dates(bands, "psi_d", "Vs", ("psi_d_low", "psi_d_high"), _singled(machines)),
    )
    columns = ("machine", "psi_d", "spread", "psi_q", "L_dd", "L_qq", "change of psi_d a year")
    table = Table("Machines: map", columns, tuple(rows), f"Means.{_cut(len(machines))}")
    return Section("Flux-linkage map", lead, [figure, table])


def _listed_machines(machines: Sequence[_Machine]) -> list[_Machine]:
    return sorted(machines, key=lambda one: one.name)[:_MOST]


def _singled(machines: Sequence[_Machine]) -> list[str]:
    """Return the machines that are drawn apart: all if they are few, else those that drift."""
    named = [one for one in machines if one.name != _UNNAMED]
    few = len(named) <= SINGLED
    return [one.name for one in named if few or one.drifting]


def _drift_title(machines: Sequence[_Machine], name: str) -> str:
    known = [drift for one in machines if (drift := one.drifts[name])]
    if not known:
        return f"{name} of every recording"
    moved = sum(drift.significant for drift in known) or "none"
    return f"{name} drifts in {moved} of {_counted(len(known), 'machine')}"


def _trust(table: pl.DataFrame) -> Section:
    """Return the section on verdicts, objections and what was not answered."""
    outcome = pl.when(pl.col("status") == ANSWERED).then("verdict").otherwise("status")
    outcomes = table.with_columns(outcome.alias("outcome"))
    share = {name: count / len(table) for name, count in outcomes["outcome"].value_counts().rows()}
    verdicts = _ranked(
        outcomes,
        "outcome",
        lambda name: (Cell(f"{100 * share[name]:.0f}{_SPACE}%", share[name], "bar"),),
    )
    blocks: list[Block] = [
        Table(
            "Verdicts",
            ("verdict", "tasks", "share", "machines"),
            verdicts,
            "Refused: the recording cannot be used. Failed: for a reason that may pass; the next "
            "start tries again.",
        )
    ]
    done = table.filter(pl.col("status") == ANSWERED)
    objections = done.with_columns(pl.col("objections").str.split("; ")).explode("objections")
    if kinds := _ranked(objections.filter(pl.col("objections") != ""), "objections"):
        blocks.append(Table("Objections", ("objection", "tasks", "machines"), kinds))
    bad = table.filter(~pl.col("answered").fill_null(False))
    if len(bad):
        why = pl.coalesce("error", "reason", pl.lit(""))
        told = bad.head(_MOST).select(
            "recording", pl.coalesce("verdict", "status"), why.alias("why")
        )
        rows = tuple(Row(tuple(map(Cell, row))) for row in told.rows())
        columns = ("recording", "verdict", "why")
        blocks.append(Table("Not answered", columns, rows, _cut(len(bad)).strip()))
    return Section("Trust", "What may be used, and what speaks against the rest.", blocks)


def _ranked(
    rows: pl.DataFrame, name: str, more: Callable[[str], tuple[Cell, ...]] = lambda _: ()
) -> tuple[Row, ...]:
    """Return a row a value of a column, the most frequent first: how many, of which machines."""
    groups = rows.group_by(name, maintain_order=True).agg(
        pl.len(), pl.col("machine").unique().sort()
    )
    return tuple(
        Row((Cell(one), _count(count), *more(one), Cell(_listed(machines))))
        for one, count, machines in groups.sort("len", descending=True, maintain_order=True).rows()
    )


def _variants(table: pl.DataFrame) -> list[Section]:
    """Return the section on variants, horizons and seeds, where there are several of one."""
    done = table.filter(pl.col("status") == ANSWERED)
    if not len(done) or all(done[name].n_unique() < 2 for name in ("variant", "horizon", "seed")):
        return []
    rows = []
    for (variant, horizon), group in done.group_by("variant", "horizon", maintain_order=True):
        values = _numbers(group, "R")
        spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
        rows.append(
            Row(
                (
                    Cell(str(variant) or "as the study says"),
                    _count(horizon or "auto"),
                    _count(len(group)),
                    _count(group["answered"].sum()),
                    _quantity(_mean(group, "R"), "ohm", 4),
                    _quantity(spread, "ohm", 2),
                    _count(with_unit(_mean(group, "free_run_rmse"), "A")),
                    _count(f"{number(_mean(group, 'processor_seconds'), 2)}{_SPACE}s"),
                )
            )
        )
    counts = ("variant", "H", "tasks", "answered")
    columns = (*counts, "R", "spread of R", "free run", "processor time")
    blocks: list[Block] = [Table("Variants and horizons", columns, tuple(rows[:_MOST]))]
    if done["selected"].n_unique() > 1:
        title = "R of every identification over its horizon"
        caption = "Seeds that agree do not show that the value is right: compare the horizons."
        blocks.insert(0, Figure(title, caption, over_horizons(done)))
    return [Section("Variants, horizons and seeds", "What the answer depends on.", blocks)]


def _tasks(table: pl.DataFrame) -> Section:
    """Return the section that lists the tasks."""
    rows = tuple(
        Row(
            (
                Cell(row["recording"]),
                Cell(row["variant"] or "–"),
                _count(row["horizon"] or "auto"),
                _count(row["seed"]),
                _quantity(row["R"], "ohm", 4),
                Cell(row["verdict"] or row["status"]),
                Cell(f"fits/{row['key']}" if row["status"] == ANSWERED else "–", kind="code"),
            )
        )
        for row in table.head(_MOST).iter_rows(named=True)
    )
    columns = ("recording", "variant", "H", "seed", "R", "verdict", "saved fit")
    lead = "penode report fits/KEY writes the report of one of them."
    return Section("Tasks", lead, [Table("Tasks", columns, rows, _cut(len(table)).strip())])


# --- cells ------------------------------------------------------------------------------------


def _count(text: object) -> Cell:
    return Cell(str(text), kind="number")


def _quantity(value: float | None, unit: str, digits: int = 3) -> Cell:
    return Cell(with_unit(value, unit, digits), value, "number")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _cut(count: int) -> str:
    """Return a sentence that says so where a table is cut."""
    return f" The first {_MOST} of {count}; table.parquet has all." if count > _MOST else ""


def _counted(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def _numbers(rows: pl.DataFrame, name: str) -> FloatArray:
    return rows[name].drop_nulls().drop_nans().to_numpy()


def _mean(rows: pl.DataFrame, name: str) -> float | None:
    values = _numbers(rows, name)
    return float(np.mean(values)) if len(values) else None
