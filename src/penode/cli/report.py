"""The command ``penode report``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from penode.fit.archive import write_atomically
from penode.fit.fit import Fit
from penode.pmsm.report.machine_report import machine_report

_output = Console()


def report_command(
    folder: Annotated[Path, typer.Argument(help="Folder that identify or demo wrote.")],
) -> None:
    """Write report.html again from a saved fit.

    Example: penode report result
    """
    page = folder / "report.html"
    write_atomically(page, machine_report(Fit.load(folder)))
    _output.print(f"report  {page}", soft_wrap=True, highlight=False)
