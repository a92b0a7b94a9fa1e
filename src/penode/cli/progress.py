"""Watching a training: the log, the view, and what an interruption leaves."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from penode.cli.event_log import EventLog
from penode.cli.ladder_view import LadderView
from penode.fit.result_folder import claimed
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.ladder import Observer


class Interrupted(Exception):  # noqa: N818 (a request, not an error)
    """A person left at once; the message says what remains."""


@contextmanager
def watched(
    folder: Path, console: Console, checkpoint: Checkpoint | None = None
) -> Iterator[Observer]:
    """Give an observer that logs into a folder and shows the ladder on a console, if a terminal.

    ``events.jsonl`` is put back as it was when the work ends in an exception and no horizon was
    finished and kept; on resuming from a checkpoint it is gone on with. Refuses a folder that
    another process writes into; raises Interrupted on Ctrl-C that nothing within has handled.
    """
    with claimed(folder), _logged(folder, console, checkpoint) as observer:
        yield observer


@contextmanager
def _logged(folder: Path, console: Console, checkpoint: Checkpoint | None) -> Iterator[Observer]:
    resumed = checkpoint is not None and checkpoint.resume
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
