"""The page of a report printed by a Chromium without a window."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from penode.errors import InputError
from penode.fit.archive import write_atomically

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
#: Seconds by the clock for loading and printing.
_WAIT = 180
#: Milliseconds of the page's own time for drawing the pictures.
_DRAWING = 10_000


def browser() -> str:
    """Return the path of a browser that prints; refuse where none is installed."""
    found = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if found is None:
        raise InputError(
            "--pdf needs Chromium or Chrome, and none is installed; install one, or print "
            "report.html from your own browser."
        )
    return found


def print_page(page: Path, pdf: Path, by: str) -> None:
    """Write a page as PDF by the browser at the path ``by``; refuse where it gives none."""
    with tempfile.TemporaryDirectory(prefix="penode-", ignore_cleanup_errors=True) as folder:
        printed = Path(folder) / "page.pdf"
        command = [
            *(by, "--headless", "--disable-gpu", "--no-pdf-header-footer"),
            # The page is our own; root and containers have no sandbox.
            *("--no-sandbox", f"--user-data-dir={folder}/profile"),
            *(f"--virtual-time-budget={_DRAWING}", f"--print-to-pdf={printed}"),
            page.resolve().as_uri(),
        ]
        try:
            subprocess.run(command, capture_output=True, timeout=_WAIT, check=False)
            content = printed.read_bytes()
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(
                f"{page}: {by} did not print it ({type(error).__name__}); print it from your own "
                "browser."
            ) from error
    write_atomically(pdf, content)
