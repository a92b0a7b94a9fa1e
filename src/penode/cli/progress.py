"""Watching a training: the log, the table, and what an interruption leaves."""

import json
import math
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.progress import Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from penode.cli.console import Interrupted
from penode.fit.archive import write_atomically
from penode.fit.result_folder import claimed
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.ladder import Observer
from penode.report.quantities import decimals_for, fixed, number, scale_for


@contextmanager
def watched(
    folder: Path, console: Console, checkpoint: Checkpoint | None = None
) -> Iterator[Observer]:
    """Give an observer that logs into a folder and shows the ladder on a console, if a terminal.

    ``events.jsonl`` is put back as it was when the work ends in an exception and no horizon was
    finished and kept; on resuming from a checkpoint it is gone on with. Refuses a folder that
    another process writes into; raises Interrupted on Ctrl-C that nothing within has handled.
    """
    resumed = checkpoint is not None and checkpoint.resume
    with claimed(folder):
        log, before = EventLog(folder, append=resumed), _stamp(checkpoint)
        try:
            with LadderView(console) as view:

                def observer(event: Mapping[str, Any]) -> None:
                    log(event)
                    view(event)

                yield observer
        except BaseException as error:
            kept = _stamp(checkpoint) != before
            log.close() if kept else log.discard()
            if isinstance(error, KeyboardInterrupt):
                remains = "no result was written"
                if kept or resumed:
                    remains = "the finished horizons are kept: add --resume to go on"
                raise Interrupted(f"Stopped; {remains}.") from error
            raise
        log.close()


def _stamp(checkpoint: Checkpoint | None) -> tuple[int, int] | None:
    """Return what distinguishes a replaced checkpoint from its predecessor, None without one."""
    if checkpoint is None or not checkpoint.path.exists():
        return None
    file = checkpoint.path.stat()
    return file.st_ino, file.st_mtime_ns


class EventLog:
    """Writes events to ``events.jsonl``, a line each, from the first one on; appends on resuming.

    Folder and file are made only when there is something to log: bad input leaves nothing behind.
    """

    def __init__(self, folder: Path, append: bool = False):
        self._path = folder / "events.jsonl"
        self._append = append
        self._file: TextIO | None = None
        self._before: bytes | None = None
        self._logged: set[int] = set()  # horizons whose rungs the log of before has
        self._began = time.monotonic()

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Log one event, unless it repeats a rung that was taken over."""
        file = self._file or self._open()
        if event["event"] == "resume":
            self._logged &= set(event["horizons"])
        if event["event"] == "rung" and event["horizon"] in self._logged:
            return
        elapsed = round(time.monotonic() - self._began, 3)
        file.write(json.dumps({"elapsed_s": elapsed, **event}) + "\n")
        file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def discard(self) -> None:
        """Put back what was there before: an earlier log, or no file."""
        self.close()
        if self._before is not None:
            write_atomically(self._path, self._before)
        elif self._file is not None:
            self._path.unlink(missing_ok=True)

    def _open(self) -> TextIO:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._before = self._path.read_bytes() if self._path.exists() else None
        if self._append and self._before is not None:
            rungs = re.findall(rb'"event": "rung", "horizon": (\d+)', self._before)
            self._logged = {int(horizon) for horizon in rungs}
        self._file = self._path.open("a" if self._append else "w")
        return self._file


class LadderView:
    """A live table of the ladder on a terminal; where the output is piped, a line a horizon."""

    def __init__(self, console: Console):
        self._console = console
        self._live = Live(console=console, refresh_per_second=8, transient=False)
        self._rows: list[tuple[str, ...]] = []
        self._now: tuple[str, ...] | None = None
        line = TextColumn("  {task.description}", style="dim")
        self._progress = Progress(
            line, TimeRemainingColumn(), console=console, speed_estimate_period=math.inf
        )
        self._line = self._progress.add_task("", total=None, visible=False)

    def __enter__(self) -> "LadderView":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live.is_started:
            self._now = None
            self._progress.update(self._line, visible=False)
            self._live.update(self.picture())
            self._live.stop()

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Show one event."""
        if event["event"] == "rung":
            self._rows.append(_row(event, str(event["evaluations"])))
            if not self._console.is_terminal:
                self._console.print(_line(event), soft_wrap=True, highlight=False)
        self._now = _row(event, "") if event["event"] == "evaluation" else None
        if said := _said(event):
            self._progress.update(self._line, description=said, visible=True)
        if "stages" in event:
            done = event["stage"] - (event["event"] == "evaluation")
            self._progress.update(self._line, total=event["stages"], completed=done)
        self._live.update(self.picture())

    def picture(self) -> Group:
        """Return the table as it stands, with a line that says what is going on."""
        table = Table(box=None, header_style="bold", padding=(0, 2))
        for column in ("horizon H", "estimate ± std", "RMSE over H steps", "evaluations"):
            table.add_column(column, justify="right")
        for row in self._rows:
            table.add_row(*row)
        if self._now is not None:
            table.add_row(*self._now, style="dim")
        return Group(*([table] if table.rows else []), self._progress)


def _said(event: Mapping[str, Any]) -> str:
    """Return what is going on from an event on; empty where that stays as it was."""
    last = event["horizons"][-1:] if event["event"] == "resume" else ()
    sentences = {
        "start": "Finding a start ...",
        "resume": f"Going on after horizon {last[0]} ..." if last else "",
        "stop": f"Stopping after horizon {event.get('horizon')}: predicting with the best so far "
        "(Ctrl-C again leaves at once) ...",
        "evaluation": f"rung {event.get('stage')} of {event.get('stages')}",
    }
    if event["event"] == "rung" and event["stage"] == event["stages"]:
        return "All horizons done: predicting the recordings ..."
    return sentences.get(event["event"], "")


def _row(event: Mapping[str, Any], evaluations: str) -> tuple[str, ...]:
    error = event["rmse"] if "rmse" in event else math.sqrt(event["loss"])
    shown = f"{number(error, 4)} {event.get('rmse_unit', '')}".rstrip()
    return (str(event["horizon"]), _values(event), shown, evaluations)


def _line(event: Mapping[str, Any]) -> str:
    """Return a finished horizon as a line of a log."""
    horizon, values, error, _ = _row(event, "")
    values = f"{values} (std)" if "±" in values else values
    found = ", ".join(filter(None, (f"H = {horizon}", values, f"RMSE over H steps {error}")))
    return f"rung {event['stage']} of {event['stages']}: {found}"


def _values(event: Mapping[str, Any]) -> str:
    """Return parameters with their deviations where these are known."""
    parts = []
    for name, value in event["parameters"].items():
        std = event.get("std", {}).get(name)
        scale = scale_for(value, event["units"][name])
        if std is None or not math.isfinite(std):
            unknown = "" if std is None else " ± unknown"
            parts.append(f"{name} = {number(value * scale.factor, 4)}{unknown} {scale.unit}")
            continue
        decimals = decimals_for(std * scale.factor, value * scale.factor)
        shown = f"{fixed(value * scale.factor, decimals)} ± {fixed(std * scale.factor, decimals)}"
        parts.append(f"{name} = {shown} {scale.unit}")
    return ", ".join(parts)
