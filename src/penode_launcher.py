"""The command ``penode``, which answers Ctrl-C in one sentence from its first import on.

It stands beside the package, whose import takes a second or two.
"""

import gc
import os
import signal
import sys
from importlib.metadata import version
from typing import NoReturn

#: Exit status of what was stopped: 128 and the number of the signal.
_STOPPED = 130


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--version"]:
        print("penode", version("penode"))
        return
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # else it is ignored, as under nohup
        signal.signal(signal.SIGINT, _leave)
    try:
        try:
            gc.disable()  # imports leave no garbage; to look for it takes a quarter of their time
            try:
                from penode.cli.main import main as run
            finally:
                gc.enable()

            signal.signal(signal.SIGINT, before)
            run()
        except KeyboardInterrupt:
            _leave()
    except KeyboardInterrupt:  # of one Ctrl-C polars makes an interrupt of its own beside Python's
        _leave()
    finally:
        # What the command had to do is done; closing down is not to be interrupted.
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _leave(*signalled: object) -> NoReturn:
    """End at once: an exception would come up inside an import, which may go on without a part."""
    sys.stderr.write("Stopped; nothing was written.\n")
    sys.stderr.flush()
    os._exit(_STOPPED)


if __name__ == "__main__":
    main()
