"""The command ``penode report``."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from penode.cli.console import print_rows
from penode.cli.options import TrustClasses
from penode.fit.archive import write_atomically
from penode.fit.fit import Fit
from penode.fit.result_folder import REPORT
from penode.pmsm.machine.model import Machine
from penode.pmsm.sweep.task import LINES


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
    # Imported here: the plotting library takes a third of a second, and few commands draw.
    from penode.pmsm.report.machine_report import machine_report
    from penode.report.fit_report import fit_report

    if (folder / LINES).exists():
        from penode.pmsm.sweep.fleet_report import fleet_report
        from penode.pmsm.sweep.table import read_table

        text = fleet_report(read_table(folder))
    else:
        if trust:
            sys.path.append(str(Path.cwd()))
        fit = Fit.load(folder, trust)
        text = machine_report(fit) if isinstance(fit.model, Machine) else fit_report(fit)
    write_atomically(page, text)
    print_rows([("report", str(page))])
