"""The command ``penode demo``."""

import time
from dataclasses import replace
from pathlib import Path

from penode.cli.console import ERRORS, say
from penode.cli.fits import print_demo, print_fit, report_beside, signed
from penode.cli.progress import watched
from penode.errors import InputError
from penode.fit.result_folder import RESULT
from penode.pmsm.demo import run_demo
from penode.pmsm.result_files import write_answer

#: Folder of what was simulated, within that of the result.
_RECORDINGS = "recordings"


def demo_command(
    out: Path,
) -> None:
    """Show the whole story on the built-in machine: record, identify, compare with the truth."""
    if (out / RESULT).exists() and not (out / _RECORDINGS).is_dir():
        raise InputError(f"{out} has a result that is not the demo's: give another --out.")
    began = time.monotonic()
    with watched(out, ERRORS) as observer:
        say("Recording the built-in machine on the simulated bench ...")
        story = run_demo(out / _RECORDINGS, observer)
        story = replace(story, fit=signed(story.fit, began))
        write_answer(story.fit, out)
    print_fit(story.fit, out)
    print_demo(story)
    report_beside(story.fit, out, truth=story.truth)
