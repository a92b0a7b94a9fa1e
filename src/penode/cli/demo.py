"""The command ``penode demo``."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from penode.cli.progress import watched
from penode.cli.report import report_beside
from penode.cli.signature import signed
from penode.cli.summary import print_demo, print_fit
from penode.errors import InputError
from penode.fit.result_folder import RESULT
from penode.pmsm.demo import run_demo
from penode.pmsm.result_files import write_answer

#: Folder of what was simulated, within that of the result.
_RECORDINGS = "recordings"
_output, _errors = Console(), Console(stderr=True)


def demo_command(
    out: Annotated[Path, typer.Option(help="Folder for the results; made if absent.")] = Path(
        "penode-demo"
    ),
) -> None:
    """Show the whole story on the built-in machine: record, identify, compare with the truth.

    Example: penode demo --out demo
    """
    if (out / RESULT).exists() and not (out / _RECORDINGS).is_dir():
        raise InputError(f"{out} has a result that is not the demo's: give another --out.")
    began = time.monotonic()
    with watched(out, _errors) as observer:
        _errors.print("Recording the built-in machine on the simulated bench ...", soft_wrap=True)
        story = run_demo(out / _RECORDINGS, observer)
        story = replace(story, fit=signed(story.fit, began))
        write_answer(story.fit, out)
    print_fit(_output, story.fit, out)
    print_demo(_output, story)
    report_beside(story.fit, out)
