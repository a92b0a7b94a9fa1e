"""The command ``penode``, run in this process as a user runs it, and what became of it."""

import contextlib
import io
import json
import shutil
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from penode.cli.main import main
from penode.fit.fit import Fit


@dataclass(frozen=True, eq=False)
class Ended:
    """How a command ended.

    Attributes
    ----------
    status : int
        Exit status.
    printed : str
        Standard output and standard error, in the order of writing.
    warned : tuple of str
        Warnings of Python that were raised on the way.
    seconds : float
        Wall time.
    out : Path or None
        Folder with the results; of ``identify`` alone.
    """

    status: int
    printed: str
    warned: tuple[str, ...]
    seconds: float
    out: Path | None = None

    @property
    def result(self) -> dict[str, Any] | None:
        """What ``result.json`` holds, None where it was not written."""
        file = self.out and self.out / "result.json"
        return json.loads(file.read_text()) if file and file.exists() else None

    @property
    def last_line(self) -> str:
        """The last line printed: of a refusal its sentence."""
        lines = [line for line in self.printed.splitlines() if line.strip()]
        return lines[-1].strip() if lines else ""

    def fit(self) -> Fit:
        """Return the saved fit, loaded again."""
        assert self.out is not None
        return Fit.load(self.out)


def run(*arguments: object) -> Ended:
    """Run ``penode`` with arguments, everything included: report, files, exit status.

    A failure of penode itself ends in exit status 70, as for a user.
    """
    printed, began, status = io.StringIO(), time.perf_counter(), 0
    with (
        mock.patch.object(sys, "argv", ["penode", *map(str, arguments)]),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("default")
        try:
            main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
    warned = tuple(f"{w.category.__name__}: {w.message} ({w.filename}:{w.lineno})" for w in caught)
    return Ended(status, printed.getvalue(), warned, time.perf_counter() - began)


def identify(files: Sequence[Path], out: Path, *options: object) -> Ended:
    """Run ``penode identify`` over files, into a folder.

    Parameters
    ----------
    files : sequence of Path
        Recordings.
    out : Path
        Gets the results; made if absent. Those of an earlier run would be taken for this one's if
        it were refused, so they are removed, unless ``--resume`` is among the options.
    *options : object
        Of the command.
    """
    if "--resume" not in options:
        shutil.rmtree(out, ignore_errors=True)
    ended = run("identify", *files, "--out", out, *options)
    return Ended(ended.status, ended.printed, ended.warned, ended.seconds, out)
