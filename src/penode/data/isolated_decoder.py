"""The child of `penode.data.isolation`: decodes files apart, under limits. Run as a script.

Its argument is the folder of the content, which goes when it ends.
It imports NumPy, one reader and that reader's library, and no other part of penode, whose
`__init__` needs seconds. What it answers is text and numbers; the parent executes none of it.
"""

import importlib
import json
import math
import os
import shutil
import signal
import sys
import threading
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_OUT_OF_MEMORY = 3
#: Bytes of the largest temporary file; libraries begin one and leave it empty.
_TEMPORARY = 1 << 20


def main() -> None:
    """Answer requests until there are no more.

    A request is a line of JSON. The answer is, for each column, a line of JSON with its name and
    length and its float64 values; then one with ``refused`` and a sentence, ``failed`` and what was
    raised, or the units and clocks of the columns, and which are text.
    """
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for printed in (1, 2):  # libraries print
        os.dup2(nowhere, printed)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is asked to stop, and ends its child
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        for block in _answer(request):
            answers.write(block)
        answers.flush()


def _answer(request: dict[str, Any]) -> Iterator[bytes | memoryview]:
    """Yield what is answered; a reader may decode its columns one by one."""
    try:
        reader = _reader(request)
        _limit(request["memory"], request["seconds"])
        with Path(request["content"]).open("rb") as source:
            table = reader.read(request["file"], source)
            for name in table.columns:
                values = table.columns[name]
                yield _line({"column": name, "length": len(values)})
                yield memoryview(values.astype("<f8", order="C", copy=False)).cast("B")
        end = {
            "units": table.units,
            "clocks": table.clocks,
            "text": table.text,
            "left_out": table.left_out,
            "numbers": table.numbers,
        }
    except Exception as error:  # libraries raise whatever damage leads them to
        refused = type(error).__name__ == "InputError"
        end = {"refused": str(error)} if refused else {"failed": _name(error)}
    yield _line(end)


def _name(error: Exception) -> str:
    """Return the name of what was raised, with its library where it is one's."""
    kind = type(error)
    return kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"


def _line(entries: dict[str, Any]) -> bytes:
    return json.dumps(entries).encode() + b"\n"


def _reader(request: dict[str, Any]) -> types.ModuleType:
    """Import a reader, and the libraries that it needs."""
    sys.path[:] = request["path"]
    reader = importlib.import_module(f"penode.data.readers.{request['reader']}")
    for library in request["libraries"]:
        try:
            importlib.import_module(library)
        except ImportError:
            break  # the reader says so
    return reader


# --- limits -------------------------------------------------------------------------------------


def _limit(memory: int, seconds: int) -> None:
    """Limit memory and computing time from here on, as far as the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    spent = math.ceil(time.process_time())
    wanted = {"RLIMIT_CPU": spent + seconds, "RLIMIT_FSIZE": _TEMPORARY, "RLIMIT_CORE": 0}
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[5])
        wanted["RLIMIT_DATA"] = pages * resource.getpagesize() + memory
    else:
        threading.Thread(target=watch_memory, args=(memory,), daemon=True).start()
    for name, value in wanted.items():
        kind = getattr(resource, name)
        hard = resource.getrlimit(kind)[1]
        inside = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (inside, hard))


def watch_memory(memory: int) -> None:
    """End this process once it has taken so many bytes more, where the system has no limit."""
    import resource

    unit = 1 if sys.platform == "darwin" else 1024

    def taken() -> int:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit

    begin = taken()
    while taken() < begin + memory:
        time.sleep(0.02)
    os._exit(_OUT_OF_MEMORY)


if __name__ == "__main__":
    try:
        main()
    finally:
        shutil.rmtree(sys.argv[1], ignore_errors=True)  # a parent that was killed cannot
