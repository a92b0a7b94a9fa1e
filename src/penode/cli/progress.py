"""What a person sees while training goes on, and the log a program can read."""

import json
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console
from rich.live import Live
from rich.table import Table

from penode.horizon.ladder import Observer
from penode.report.quantities import decimals_for, fixed, number, scale_for


class EventLog:
    """Appends events to ``events.jsonl``, a line each, from the first evaluation on.

    Parameters
    ----------
    folder : Path
        Made, with the file, only when there is something to log: bad input leaves nothing behind.
    """

    def __init__(self, folder: Path):
        self._path = folder / "events.jsonl"
        self._file: TextIO | None = None
        self._began = time.monotonic()

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Log one event."""
        if self._file is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("w")
        elapsed = round(time.monotonic() - self._began, 3)
        self._file.write(json.dumps({"elapsed_s": elapsed, **event}) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def discard(self) -> None:
        """Remove the file, and its folder if nothing else is in it."""
        self.close()
        if self._file is not None:
            self._path.unlink(missing_ok=True)
            if not any(self._path.parent.iterdir()):
                self._path.parent.rmdir()


class Stopped(Exception):  # noqa: N818 (a request, not an error)
    """A person stopped the work."""


@contextmanager
def watched(folder: Path, console: Console) -> Iterator[Observer]:
    """Give an observer that logs into a folder and shows the ladder on a console.

    Parameters
    ----------
    folder : Path
        Gets ``events.jsonl``; nothing is left of it when the work ends in an exception.
    console : Console
        Shows the live table if it is a terminal.

    Raises
    ------
    Stopped
        On Ctrl-C.
    """
    log = EventLog(folder)
    try:
        with LadderView(console) as view:

            def observer(event: Mapping[str, Any]) -> None:
                log(event)
                view(event)

            yield observer
    except KeyboardInterrupt as interrupt:
        log.discard()
        raise Stopped from interrupt
    except BaseException:
        log.discard()
        raise
    log.close()


class LadderView:
    """A live table of the ladder on a terminal; nothing where the output is piped.

    Parameters
    ----------
    console : Console
        Standard error.
    """

    def __init__(self, console: Console):
        self._console = console
        self._live = Live(console=console, refresh_per_second=8, transient=False)
        self._rows: list[tuple[str, ...]] = []

    def __enter__(self) -> "LadderView":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live.is_started:
            self._live.update(self._table(None))
            self._live.stop()

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Show one event."""
        if event["event"] == "rung":
            self._rows.append(_rung_row(event))
            self._live.update(self._table(None))
        elif event["event"] == "evaluation":
            self._live.update(self._table(event))

    def _table(self, now: Mapping[str, Any] | None) -> Table:
        table = Table(box=None, header_style="bold", padding=(0, 2))
        for column in ("horizon", "estimate", "RMSE", "evaluations"):
            table.add_column(column, justify="right")
        for row in self._rows:
            table.add_row(*row)
        if now is not None:
            stage = f"rung {now['stage']} of {now['stages']}"
            table.add_row(str(now["horizon"]), _values(now), _rmse(now["loss"]), stage, style="dim")
        return table


def _rung_row(event: Mapping[str, Any]) -> tuple[str, ...]:
    rmse = _rmse(event["rmse"] ** 2)
    return (str(event["horizon"]), _values(event), rmse, str(event["evaluations"]))


def _rmse(loss: float) -> str:
    return number(math.sqrt(loss), 4)


def _values(event: Mapping[str, Any]) -> str:
    """Return parameters with their deviations where these are known."""
    parts = []
    for name, value in event["parameters"].items():
        std = event.get("std", {}).get(name)
        scale = scale_for(value, event["units"][name])
        if std is None:
            parts.append(f"{name} = {number(value * scale.factor, 4)} {scale.unit}")
            continue
        decimals = decimals_for(std * scale.factor, value * scale.factor)
        shown = f"{fixed(value * scale.factor, decimals)} ± {fixed(std * scale.factor, decimals)}"
        parts.append(f"{name} = {shown} {scale.unit}")
    return ", ".join(parts)
