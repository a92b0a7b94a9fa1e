"""The command ``penode``, which answers Ctrl-C in one sentence from its first import on.

It stands beside the package, so that nothing of it is imported before.
"""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import NoReturn

#: Exit status of what was stopped: 128 and the number of the signal.
_STOPPED = 130


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--version"]:
        print("penode", version("penode"))
        return
    try:
        try:
            with undisturbed():
                from penode.cli.main import main as run
            run()
        except KeyboardInterrupt:
            _leave()
    except KeyboardInterrupt:  # of one Ctrl-C polars makes an interrupt of its own beside Python's
        _leave()
    finally:
        # What the command had to do is done; closing down is not to be interrupted.
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Import in here: Ctrl-C ends the process at once, and no time is lost looking for garbage."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # else it is ignored, as under nohup
        signal.signal(signal.SIGINT, _leave)
    gc.disable()  # imports leave no garbage; to look for it takes a quarter of their time
    try:
        yield
    finally:
        gc.enable()
        signal.signal(signal.SIGINT, before)


def _leave(*signalled: object) -> NoReturn:
    """End at once: an exception would come up inside an import, which may go on without a part."""
    sys.stderr.write("Stopped; nothing was written.\n")
    sys.stderr.flush()
    os._exit(_STOPPED)


if __name__ == "__main__":
    main()
