"""The command ``penode report``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from penode.cli.console import print_rows
from penode.cli.fits import load_machine
from penode.cli.pdf import browser, print_page
from penode.errors import InputError, require_extra
from penode.fit.archive import write_atomically
from penode.fit.fit import Fit
from penode.fit.result_folder import REPORT
from penode.pmsm.machine.flux_grid import read_grid
from penode.pmsm.machine.model import Machine
from penode.pmsm.sweep.task import LINES

if TYPE_CHECKING:
    from penode.pmsm.report.against import Against


def report_command(
    folder: Path,
    against: Path | None,
    pdf: bool,
    trust: bool,
) -> None:
    """Write report.html from a saved fit, of a machine or of any other model, or from a sweep."""
    page, printer = folder / REPORT, browser() if pdf else None
    # Imported here: the plotting library takes a third of a second, and few commands draw.
    from penode.pmsm.report.machine_report import machine_report
    from penode.report.fit_report import fit_report

    if (folder / LINES).exists():
        if against is not None:
            raise InputError(f"{folder}: --against must be for one machine, got a sweep; leave it.")
        require_extra("polars", "tables", "the report of a sweep")
        from penode.pmsm.sweep.fleet_report import fleet_report
        from penode.pmsm.sweep.table import read_table

        text = fleet_report(read_table(folder))
    else:
        if trust:
            sys.path.append(str(Path.cwd()))
        fit = load_machine(folder, trust) if against is not None else Fit.load(folder, trust)
        if isinstance(fit.model, Machine):
            second = None if against is None else _held_against(fit, against, trust)
            text = machine_report(fit, second)
        else:
            text = fit_report(fit)
    write_atomically(page, text)
    written = [page]
    if printer is not None:
        written.append(page.with_suffix(".pdf"))
        print_page(page, written[-1], printer)
    print_rows([("report", str(path)) for path in written])


def _held_against(fit: Fit, path: Path, trust: bool = False) -> "Against":
    """Return what the page says of a second map, that of a CSV file or of a saved fit."""
    from penode.pmsm.report.against import Against

    table = path.suffix.lower() == ".csv"
    if path.is_file() and not table:
        raise InputError(
            f"{path}: --against must be a CSV such as flux_map.csv or the folder of a result; give "
            "the folder, or export the map as CSV."
        )
    return Against.of(fit, str(path), read_grid(path) if table else load_machine(path, trust))
