"""Sections of the report of a sweep on tasks: what may be used, what the answer depends on."""

import numpy as np
import polars as pl

from penode.pmsm.sweep.fleet_figures import over_horizons
from penode.pmsm.sweep.task import ANSWERED, FAILED, REFUSED
from penode.report.document import Block, Cell, Figure, Row, Section, Table
from penode.report.quantities import number, with_unit

#: Most rows of a table of the page; the sweep's own table has all.
MOST = 60
_SPACE = "\N{NO-BREAK SPACE}"


def trust(table: pl.DataFrame) -> Section:
    """Return the section on verdicts, objections and what was not answered."""
    done = table.filter(pl.col("status") == ANSWERED)
    verdicts = [
        Row(
            (
                Cell(str(verdict)),
                Cell(str(len(group)), kind="number"),
                Cell(
                    f"{100 * len(group) / len(table):.0f}{_SPACE}%", len(group) / len(table), "bar"
                ),
                Cell(_listed(group["machine"])),
            )
        )
        for (verdict,), group in done.group_by("verdict", maintain_order=True)
    ]
    for status in (REFUSED, FAILED):
        group = table.filter(pl.col("status") == status)
        if len(group):
            share = len(group) / len(table)
            cells = (
                Cell(status),
                Cell(str(len(group)), kind="number"),
                Cell(f"{100 * share:.0f}{_SPACE}%", share, "bar"),
                Cell(_listed(group["machine"])),
            )
            verdicts.append(Row(cells))
    blocks: list[Block] = [
        Table(
            "Verdicts",
            ("verdict", "tasks", "share", "machines"),
            tuple(sorted(verdicts, key=lambda row: -int(row.cells[1].text))),
            "Refused: the recording cannot be used. Failed: for a reason that may pass; the next "
            "start tries again.",
        )
    ]
    objections = done.with_columns(pl.col("objections").str.split("; ")).explode("objections")
    objections = objections.filter(pl.col("objections") != "")
    kinds = [
        Row(
            (Cell(str(name)), Cell(str(len(group)), kind="number"), Cell(_listed(group["machine"])))
        )
        for (name,), group in objections.group_by("objections", maintain_order=True)
    ]
    if kinds:
        ranked = tuple(sorted(kinds, key=lambda row: -int(row.cells[1].text)))
        blocks.append(Table("Objections", ("objection", "tasks", "machines"), ranked))
    bad = table.filter(~pl.col("answered").fill_null(False))
    if len(bad):
        rows = tuple(
            Row(
                (
                    Cell(row["recording"]),
                    Cell(row["verdict"] or row["status"]),
                    Cell(row["error"] or row["reason"] or ""),
                )
            )
            for row in bad.head(MOST).iter_rows(named=True)
        )
        columns = ("recording", "verdict", "why")
        blocks.append(Table("Not answered", columns, rows, cut(len(bad)).strip()))
    return Section("Trust", "What may be used, and what speaks against the rest.", blocks)


def variants(table: pl.DataFrame) -> list[Section]:
    """Return the section on variants, horizons and seeds, where there are several of one."""
    done = table.filter(pl.col("status") == ANSWERED)
    few = [done[name].n_unique() < 2 for name in ("variant", "horizon", "seed")]
    if all(few) or not len(done):
        return []
    rows = []
    groups = done.group_by("variant", "horizon", maintain_order=True)
    for (variant, horizon), group in groups:
        mean, values = mean_of(group, "R"), group["R"].drop_nulls()
        std = float(values.std() or 0.0) if len(values) > 1 else None  # type: ignore[arg-type]
        seconds = float(group["processor_seconds"].mean() or 0.0)  # type: ignore[arg-type]
        rows.append(
            Row(
                (
                    Cell(str(variant) or "as the study says"),
                    Cell("auto" if horizon is None else str(horizon), kind="number"),
                    Cell(str(len(group)), kind="number"),
                    Cell(str(int(group["answered"].sum())), kind="number"),
                    Cell(with_unit(mean, "ohm", 4), mean, "number"),
                    Cell(with_unit(std, "ohm", 2), std, "number"),
                    Cell(with_unit(mean_of(group, "free_run_rmse"), "A"), kind="number"),
                    Cell(f"{number(seconds, 2)}{_SPACE}s", kind="number"),
                )
            )
        )
    columns = (
        "variant",
        "H",
        "tasks",
        "answered",
        "R",
        "spread of R",
        "free run",
        "processor time",
    )
    blocks: list[Block] = [Table("Variants and horizons", columns, tuple(rows[:MOST]))]
    if done["selected"].n_unique() > 1:
        title = "R of every identification over its horizon"
        caption = "That seeds agree says nothing of their value being right: look at the horizon."
        blocks.insert(0, Figure(title, caption, over_horizons(done)))
    return [Section("Variants, horizons and seeds", "What the answer depends on.", blocks)]


def tasks(table: pl.DataFrame) -> Section:
    """Return the section that lists the tasks."""
    rows = tuple(
        Row(
            (
                Cell(row["recording"]),
                Cell(row["variant"] or "–"),
                Cell("auto" if row["horizon"] is None else str(row["horizon"]), kind="number"),
                Cell(str(row["seed"]), kind="number"),
                Cell(with_unit(row["R"], "ohm", 4), row["R"], "number"),
                Cell(row["verdict"] or row["status"]),
                Cell(f"fits/{row['key']}" if row["status"] == ANSWERED else "–", kind="code"),
            )
        )
        for row in table.head(MOST).iter_rows(named=True)
    )
    columns = ("recording", "variant", "H", "seed", "R", "verdict", "saved fit")
    lead = "penode report fits/KEY writes the report of one of them."
    return Section("Tasks", lead, [Table("Tasks", columns, rows, cut(len(table)).strip())])


def _listed(machines: pl.Series) -> str:
    names = sorted(set(machines.to_list()))
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def cut(count: int) -> str:
    """Return a sentence that says so where a table is cut."""
    return f" The first {MOST} of {count}; table.parquet has all." if count > MOST else ""


def counted(count: int, word: str) -> str:
    """Return a number of things in words."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def mean_of(rows: pl.DataFrame, name: str) -> float | None:
    """Return the mean of a column, None where it has no number."""
    values = rows[name].drop_nulls().drop_nans()
    return float(np.mean(values.to_numpy())) if len(values) else None
