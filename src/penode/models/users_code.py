"""Which line of the user's own code a mistake stands in, for messages."""

import linecache
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path
from types import FrameType, TracebackType

#: Packages whose lines are not the user's.
_LIBRARIES = frozenset((*sys.stdlib_module_names, "equinox", "jax", "jaxlib", "numpy", "scipy"))


def failing_line(trace: TracebackType | None) -> str:
    """Return the innermost line of a traceback that is the user's, penode's where none is.

    Such as ``line 12 of pendulum.py, "if x[0] > 0:"``; empty if all lines are libraries'.
    """
    return _last(traceback.walk_tb(trace))


def declaring_line() -> str:
    """Return the user's line that is being run, outermost penode left out; see `failing_line`."""
    frames = [(f, n) for f, n in traceback.walk_stack(sys._getframe(1)) if _package(f) != "penode"]
    return _last(reversed(frames[:1]))


def _last(frames: Iterable[tuple[FrameType, int]]) -> str:
    own = [pair for pair in frames if _package(pair[0]) not in _LIBRARIES]
    users = [pair for pair in own if _package(pair[0]) != "penode"]
    if not own:
        return ""
    frame, line = (users or own)[-1]
    file = frame.f_code.co_filename
    linecache.checkcache(file)
    text = linecache.getline(file, line, frame.f_globals).strip()
    return f"line {line} of {Path(file).name}" + (f', "{text}"' if text else "")


def _package(frame: FrameType) -> str:
    """Return the package of a frame, by its file where JAX has kept nothing else."""
    name = frame.f_globals.get("__name__")
    if name is None:
        file, modules = frame.f_code.co_filename, tuple(sys.modules.items())
        name = next((n for n, m in modules if getattr(m, "__file__", None) == file), "")
    return str(name).partition(".")[0]
