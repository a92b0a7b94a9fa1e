"""The command ``penode sweep``."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from penode.cli.options import (
    AngleOrders,
    Config,
    FluxMapOption,
    HoldOption,
    Inverter,
    Terms,
    given,
    whole_numbers,
)
from penode.cli.progress import Interrupted
from penode.cli.sweep_workers import cluster, processes
from penode.errors import require_extra
from penode.fit.archive import write_atomically
from penode.fit.result_folder import claimed
from penode.pmsm.sweep.campaign import load_campaign
from penode.report.quantities import number, with_unit

if TYPE_CHECKING:
    import polars as pl

_output, _errors = Console(), Console(stderr=True)


def sweep_command(  # noqa: PLR0913 (an argument an option)
    out: Annotated[Path, typer.Option(help="Folder for the results; made if absent.")],
    runs: Annotated[
        list[Path] | None,
        typer.Argument(help="Recordings, each by itself, in place of the study file's."),
    ] = None,
    horizons: Annotated[
        str | None,
        typer.Option(
            help="Steps, with commas between them, or auto.", show_default="the study's, or auto"
        ),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(help="Seeds at each horizon, from 0.", show_default="one")
    ] = None,
    config: Config = None,
    flux_map: FluxMapOption = None,
    inverter: Inverter = None,
    terms: Terms = None,
    angle_orders: AngleOrders = None,
    hold: HoldOption = None,
    jobs: Annotated[
        int | None, typer.Option(help="Processes side by side.", show_default="one a core")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(help="Scheduler of a Dask cluster to work on, host:port.")
    ] = None,
) -> None:
    """Identify many recordings, each by itself, at horizons, from seeds, in variants.

    What is swept stands in the table [sweep] of the study file, or in options. Writes table.jsonl,
    a line a task as it ends, fits/KEY for penode report and penode export, and at the end
    table.parquet and report.html.

    Ctrl-C stops; the same command goes on. What is finished is not done again as long as data,
    settings and penode are the same; to change the study file adds to the table.

    Example: penode sweep run.csv --horizons 1,10,100 --seeds 3 --out sweep

    Example: penode sweep --config fleet.toml --out fleet --jobs 8
    """
    require_extra("polars", "tables", "a sweep")
    from penode.pmsm.sweep.fleet_report import fleet_report
    from penode.pmsm.sweep.run import sweep
    from penode.pmsm.sweep.table import LINES, PARQUET, read_table

    options = given(
        flux_map=flux_map, inverter=inverter, terms=terms, angle_orders=angle_orders, hold=hold
    )
    asked = given(horizons=None if horizons is None else _horizons(horizons), seeds=seeds)
    campaign = load_campaign(config, runs or (), options, asked)
    workers = processes(_cores() if jobs is None else jobs) if dask is None else cluster(dask)
    try:
        with claimed(out):
            with workers as at_work:
                for count, row in enumerate(sweep(campaign, out, at_work), 1):
                    _say(f"{count}/{len(campaign)} {_told(row)}")
            table = read_table(out)
            write_atomically(out / "report.html", fleet_report(table))
    except KeyboardInterrupt as error:
        message = "Stopped; what is finished is kept, and the same command goes on."
        raise Interrupted(message) from error
    _print_table(table)
    for what, name in (("lines", LINES), ("table", PARQUET), ("report", "report.html")):
        _output.print(f"{what:7} {out / name}", soft_wrap=True, highlight=False)
    if not (table["status"] == "done").any():
        raise typer.Exit(1)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _horizons(text: str) -> list[Any]:
    parts = [part.strip() for part in text.split(",")]
    numbers = ",".join(part for part in parts if part != "auto")
    wanted = iter(whole_numbers("horizons", numbers) if numbers else ())
    return [part if part == "auto" else next(wanted) for part in parts]


def _told(row: dict[str, Any]) -> str:
    horizon = "auto" if row["horizon"] is None else row["horizon"]
    name = " ".join(part for part in (row["recording"], row["variant"]) if part)
    return f"{name}, H = {horizon}, seed {row['seed']}: {_answer(row)}"


def _answer(row: dict[str, Any]) -> str:
    if row.get("error"):
        return str(row["error"])
    value = with_unit(row.get("R"), "ohm", 4)
    return f"R {value}, {row['verdict']}, {row['seconds']:.1f} s"


def _print_table(table: "pl.DataFrame") -> None:
    """Print a row a variant and horizon: how many, their R, and what it varies by."""
    shown = Table(box=None, padding=(0, 2, 0, 0))
    varied = table["variant"].n_unique() > 1
    for title in (
        *(("variant",) if varied else ()),
        "H",
        "tasks",
        "R",
        "answered",
        "refused",
        "failed",
    ):
        shown.add_column(title, justify="left" if title == "variant" else "right")
    for (variant, horizon), group in table.group_by("variant", "horizon", maintain_order=True):
        name = (str(variant),) if varied else ()
        status = group["status"]
        counts = [group["answered"].sum(), *((status == s).sum() for s in ("refused", "failed"))]
        few = "auto" if horizon is None else str(horizon)
        shown.add_row(
            *name,
            few,
            str(len(group)),
            _spread(group["R"].drop_nulls().to_list()),
            *map(str, counts),
        )
    _output.print(shown)


def _spread(values: Sequence[float]) -> str:
    if not values:
        return "–"
    middle, half = sum(values) / len(values), (max(values) - min(values)) / 2
    text = with_unit(middle, "ohm", 4)
    return f"{text} ± {number(100 * half / abs(middle), 2)} %" if half and middle else text


def _say(text: str) -> None:
    _errors.print(text, soft_wrap=True, highlight=False, markup=False)
