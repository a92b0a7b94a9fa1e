"""The command ``penode report``."""

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from penode.cli.last_resort import of_the_system
from penode.cli.options import TrustClasses
from penode.cli.progress import Interrupted
from penode.errors import InputError, require_extra
from penode.fit.archive import write_atomically
from penode.fit.fit import Fit
from penode.fit.left_out import LOG, left_out
from penode.fit.result_folder import REPORT, claimed
from penode.pmsm.machine.model import Machine
from penode.pmsm.result_files import write_report

_output = Console()


def report_command(
    folder: Annotated[
        Path, typer.Argument(help="Folder that identify, demo, sweep or Fit.save wrote.")
    ],
    trust: TrustClasses = False,
) -> None:
    """Write report.html from a saved fit, of a machine or of any other model, or from a sweep.

    A model of your own is imported from its module with --trust-classes alone, as this runs the
    module: give the command in that module's folder, or name the folder in PYTHONPATH.

    Example: penode report result

    Example: penode report fleet

    Example: penode report motor --trust-classes
    """
    page = folder / REPORT
    if (folder / "table.jsonl").exists():
        require_extra("polars", "tables", "the report of a sweep")
        from penode.pmsm.sweep.fleet_report import fleet_report
        from penode.pmsm.sweep.table import read_table

        write_atomically(page, fleet_report(read_table(folder)))
        _print_place(page)
        return
    if trust:
        sys.path.append(str(Path.cwd()))
    fit = Fit.load(folder, trust)
    # Imported here: the plotting library takes a third of a second.
    from penode.pmsm.report.machine_report import machine_report
    from penode.report.fit_report import fit_report

    of_kind = machine_report if isinstance(fit.model, Machine) else fit_report
    write_atomically(page, of_kind(fit))
    _print_place(page)


def report_beside(fit: Fit, folder: Path, quiet: bool = False) -> None:
    """Make the report of a machine's result that lies whole in a folder; Ctrl-C is Interrupted.

    Where it cannot be made, that is said on standard error, and the result stands.
    """
    try:
        with claimed(folder):
            write_report(fit, folder)
    except KeyboardInterrupt as error:
        raise Interrupted(
            f"Stopped; the result is written, its report is not: penode report {folder} makes it."
        ) from error
    except (InputError, OSError) as error:
        reason = of_the_system(error) if isinstance(error, OSError) else error
        LOG.warning("The report was not written: %s", reason)
    except Exception as error:
        left_out("the report", error)
    else:
        if not quiet:
            _print_place(folder / REPORT)


def _print_place(page: Path) -> None:
    _output.print(f"report  {page}", soft_wrap=True, highlight=False)
