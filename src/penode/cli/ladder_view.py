"""What a person sees while training goes on: the ladder so far, and how long it still takes."""

import math
from collections.abc import Mapping
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from penode.cli.time_left import TimeLeft, in_words
from penode.report.quantities import decimals_for, fixed, number, scale_for


class LadderView:
    """A live table of the ladder on a terminal; nothing where the output is piped."""

    def __init__(self, console: Console):
        self._console = console
        self._live = Live(console=console, refresh_per_second=8, transient=False)
        self._left = TimeLeft()
        self._rows: list[tuple[str, ...]] = []
        self._now: tuple[str, ...] | None = None
        self._line = ""

    def __enter__(self) -> "LadderView":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live.is_started:
            self._now, self._line = None, ""
            self._live.update(self.picture())
            self._live.stop()

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Show one event."""
        self._left(event)
        if event["event"] == "rung":
            self._rows.append(_row(event, str(event["evaluations"])))
        self._now = _row(event, "") if event["event"] == "evaluation" else None
        self._line = self._say(event) or self._line
        self._live.update(self.picture())

    def _say(self, event: Mapping[str, Any]) -> str:
        if event["event"] == "start":
            return "Finding a start ..."
        if event["event"] == "resume" and event["horizons"]:
            return f"Going on after horizon {event['horizons'][-1]} ..."
        if event["event"] == "stop":
            return (
                f"Stopping after horizon {event['horizon']}: predicting with the best so far "
                "(Ctrl-C again leaves at once) ..."
            )
        if event["event"] == "rung" and event["stage"] == event["stages"]:
            return "All horizons done: predicting the recordings ..."
        if event["event"] == "evaluation":
            left = self._left.seconds
            time_left = "" if left is None else f", {in_words(left)} left"
            return f"rung {event['stage']} of {event['stages']}{time_left}"
        return ""

    def picture(self) -> Group:
        """Return the table as it stands, with a line that says what is going on."""
        table = Table(box=None, header_style="bold", padding=(0, 2))
        for column in ("horizon", "estimate", "RMSE", "evaluations"):
            table.add_column(column, justify="right")
        for row in self._rows:
            table.add_row(*row)
        if self._now is not None:
            table.add_row(*self._now, style="dim")
        parts = [table] if self._rows or self._now else []
        return Group(*parts, *([Text(f"  {self._line}", style="dim")] if self._line else []))


def _row(event: Mapping[str, Any], evaluations: str) -> tuple[str, ...]:
    error = event["rmse"] if "rmse" in event else math.sqrt(event["loss"])
    return (str(event["horizon"]), _values(event), number(error, 4), evaluations)


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
