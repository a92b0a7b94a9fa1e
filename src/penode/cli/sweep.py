"""The command ``penode sweep``."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.table import Table

from penode.cli import options
from penode.cli.console import OUTPUT, Interrupted, print_rows, say
from penode.cli.sweep_workers import cluster, processes
from penode.errors import require_extra
from penode.fit.archive import write_atomically
from penode.fit.result_folder import REPORT, claimed
from penode.pmsm.sweep.campaign import load_campaign
from penode.pmsm.sweep.task import ANSWERED, FAILED, LINES, REFUSED
from penode.report.quantities import number, with_unit

if TYPE_CHECKING:
    import polars as pl


def sweep_command(  # noqa: PLR0913 (an argument an option)
    out: Path,
    runs: list[Path] | None,
    horizons: str | None,
    seeds: int | None,
    config: Path | None,
    flux_map: str | None,
    inverter: bool | None,
    terms: str | None,
    angle_orders: str | None,
    hold: str | None,
    jobs: int | None,
    dask: str | None,
) -> None:
    """Identify many recordings, each by itself, at horizons, from seeds, in variants."""
    require_extra("polars", "tables", "a sweep")
    from penode.pmsm.sweep.run import sweep
    from penode.pmsm.sweep.table import PARQUET, read_table

    settings = options.given(
        flux_map=flux_map, inverter=inverter, terms=terms, angle_orders=angle_orders, hold=hold
    )
    asked = options.given(horizons=None if horizons is None else _horizons(horizons), seeds=seeds)
    campaign = load_campaign(config, runs or (), settings, asked)
    workers = processes(_cores() if jobs is None else jobs) if dask is None else cluster(dask)
    try:
        with claimed(out):
            with workers as at_work:
                for count, row in enumerate(sweep(campaign, out, at_work), 1):
                    say(f"{count}/{len(campaign)} {_told(row)}")
            # Imported here: the plotting library takes a third of a second, and few commands draw.
            from penode.pmsm.sweep.fleet_report import fleet_report

            table = read_table(out)
            write_atomically(out / REPORT, fleet_report(table))
    except KeyboardInterrupt as error:
        message = "Stopped; what is finished is kept, and the same command goes on."
        raise Interrupted(message) from error
    OUTPUT.print(_summary(table))
    files = {"lines": LINES, "table": PARQUET, "report": REPORT}
    print_rows([(what, str(out / name)) for what, name in files.items()])
    if not (table["status"] == ANSWERED).any():
        raise typer.Exit(1)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _horizons(text: str) -> list[Any]:
    parts = [part.strip() for part in text.split(",")]
    return [
        part if part == "auto" else options.whole_numbers("horizons", part)[0] for part in parts
    ]


def _told(row: dict[str, Any]) -> str:
    horizon = "auto" if row["horizon"] is None else row["horizon"]
    name = " ".join(part for part in (row["recording"], row["variant"]) if part)
    answer = row.get("error") or (
        f"R {with_unit(row.get('R'), 'ohm', 4)}, {row['verdict']}, {row['seconds']:.1f} s"
    )
    return f"{name}, H = {horizon}, seed {row['seed']}: {answer}"


def _summary(table: "pl.DataFrame") -> Table:
    """Return a row a variant and horizon: how many, their R, and what it varies by."""
    import polars as pl

    status, resistance = pl.col("status"), pl.col("R")
    groups = table.group_by("variant", "horizon", maintain_order=True).agg(
        pl.len(),
        resistance.mean(),
        ((resistance.max() - resistance.min()) / 2).alias("half"),
        pl.col("answered").sum(),
        (status == REFUSED).sum().alias("refused"),
        (status == FAILED).sum().alias("failed"),
    )
    named = table["variant"].n_unique() > 1
    shown = Table(box=None, padding=(0, 2, 0, 0))
    for title in ("variant", "H", "tasks", "R", "answered", "refused", "failed")[not named :]:
        shown.add_column(title, justify="left" if title == "variant" else "right")
    for variant, horizon, count, middle, half, *counts in groups.iter_rows():
        text = with_unit(middle, "ohm", 4)
        spread = f" ± {number(100 * half / abs(middle), 2)} %" if half and middle else ""
        cells = [variant, horizon or "auto", count, text + spread, *counts]
        shown.add_row(*map(str, cells[not named :]))
    return shown
