"""For the whole process: output that every terminal can show, Ctrl-C that is not lost."""

import _thread
import codecs
import io
import os
import sys
import threading

#: What encodings without these characters show in their place.
_SPELLED = {
    "Ω": "ohm",
    "µ": "u",
    "ψ": "psi",
    "±": "+-",
    "×": "x",
    "·": "*",
    "²": "^2",
    "°": "deg",
    "–": "-",
    "−": "-",
    "…": "...",
    "\N{NO-BREAK SPACE}": " ",
}

#: Seconds after which a lost interrupt is raised again, where the program then is.
_LATER = 0.05


class _Pipe(io.FileIO):
    """An output whose reader may be gone: what nobody reads is dropped, and the work goes on."""

    def write(self, data: object) -> int:
        try:
            return super().write(data)  # type: ignore[arg-type]
        except BrokenPipeError:
            return memoryview(data).nbytes  # type: ignore[arg-type]


def use_tolerant_streams() -> None:
    """Make standard output and error spell what they cannot encode and outlive their readers.

    Streams that a program has put in their place stay.
    """
    codecs.register_error("penode.spelled", _spell)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper) and stream is getattr(sys, f"__{name}__"):
            stream.flush()
            tolerant = io.TextIOWrapper(
                io.BufferedWriter(_Pipe(stream.fileno(), "w", closefd=False)),
                encoding=stream.encoding,
                errors="penode.spelled",
                line_buffering=stream.line_buffering,
            )
            setattr(sys, name, tolerant)


def flush_output() -> None:
    """Write what standard output still holds; drop it and raise OSError where that fails."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (kept to the end)
        raise


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_SPELLED.get(c, "?") for c in error.object[error.start : error.end]), error.end


def raise_lost_interrupts() -> None:
    """Raise an interrupt again that came inside a destructor or a callback.

    Python drops an exception there and prints it; what else it drops is printed as before.
    """
    sys.unraisablehook = _dropped


def _dropped(dropped: "sys.UnraisableHookArgs") -> None:
    if not issubclass(dropped.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(dropped)
        return
    timer = threading.Timer(_LATER, _thread.interrupt_main)
    timer.daemon = True
    timer.start()
