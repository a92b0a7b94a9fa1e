"""The report on failures that no command expects: a sentence, an exit status, a file to send."""

import os
import platform
import sys
import tempfile
import traceback
from importlib.metadata import version

#: Exit status of a failure inside penode (EX_SOFTWARE of sysexits.h).
FAILED = 70


def of_the_system(error: OSError) -> str:
    """Return a sentence on a file that could not be read or written.

    Parameters
    ----------
    error : OSError
    """
    what = f"{error.filename}: " if error.filename else ""
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return f"{what}a file is there where a folder was wanted; give another place."
    reason = error.strerror or str(error)
    return (
        f"{what}{reason[:1].lower()}{reason[1:]}; give another place, or mend its permissions or "
        "free some space."
    )


def of_memory(error: MemoryError) -> str:
    """Return a sentence on what does not fit into the memory.

    Parameters
    ----------
    error : MemoryError
    """
    what = f" ({error})" if str(error) else ""
    return f"the memory does not suffice{what}; ask for less, or record for a shorter time."


def of_penode(error: Exception) -> str:
    """Write the details of a failure into a file, and return a sentence that names it.

    Parameters
    ----------
    error : Exception
    """
    lines = [
        f"penode {version('penode')}, Python {platform.python_version()}, {platform.platform()}\n",
        f"{' '.join(sys.argv)}\n\n",
        *traceback.format_exception(error),
    ]
    what = f"{type(error).__name__}: {error}".splitlines()[0][:200]
    message = f"penode failed where it should not ({what})"
    try:
        handle, path = tempfile.mkstemp(prefix="penode-failure-", suffix=".txt", text=True)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.writelines(lines)
    except OSError:
        return f"{message}; its details could not be written."
    return f"{message}; please send in {path}, which has the details."
