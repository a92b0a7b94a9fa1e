"""How long a training still takes, from what the horizons before it took."""

import time
from collections.abc import Callable, Mapping
from typing import Any

Clock = Callable[[], float]


class TimeLeft:
    """Watches events and estimates the seconds left, by a clock in s.

    An evaluation costs about the same at every horizon, as a long one has fewer windows. The first
    horizon alone starts cold and says nothing about how many evaluations the others need, so there
    is no estimate before the second one is done.
    """

    def __init__(self, clock: Clock = time.monotonic):
        self._clock = clock
        self._stage, self._stages = 0, 0
        self._done = 0  # evaluations at the present horizon
        self._last = 0.0  # time of the last of them
        self._paces: list[float] = []  # s for each evaluation, at any horizon
        self._efforts: list[int] = []  # evaluations for each finished horizon but the first

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Take note of one event."""
        if event["event"] not in ("evaluation", "rung"):
            return
        now, same = self._clock(), event["stage"] == self._stage and self._done
        self._stage, self._stages = event["stage"], event["stages"]
        if event["event"] == "rung":
            self._done = 0
            self._efforts += [event["evaluations"]] if event["stage"] > 1 else []
            return
        self._paces += [now - self._last] if same else []
        self._done, self._last = self._done + 1, now

    @property
    def seconds(self) -> float | None:
        """Estimate, or None where there is nothing to go by."""
        if not self._efforts or not self._paces:
            return None
        effort = sum(self._efforts) / len(self._efforts)
        ahead = self._stages - self._stage
        present = max(effort - self._done, 1.0) if self._done else 0.0
        return (ahead * effort + present) * sum(self._paces) / len(self._paces)


def in_words(seconds: float) -> str:
    """Return a duration as coarse as an estimate is: ``"about 20 s"``."""
    if seconds < 7.5:
        return "a few seconds"
    if seconds < 57.5:
        return f"about {5 * round(seconds / 5)} s"
    if seconds < 57.5 * 60:
        return f"about {max(round(seconds / 60), 1)} min"
    hours = max(round(seconds / 3600, 1 if seconds < 9.5 * 3600 else None), 1)
    return f"about {hours:g} h"
