"""Parts of a result that fail: left out by name, so that the rest of it stands."""

import logging
import os
import platform
import sys
import tempfile
import traceback
from importlib.metadata import version

#: Gets a warning for each part that is left out; without a handler it is printed on standard error.
LOG = logging.getLogger("penode")


def in_short(error: Exception) -> str:
    """Return the kind and the message of an error in one line."""
    return f"{type(error).__name__}: {error}".rstrip(": ").splitlines()[0][:200]


def details_file(error: Exception) -> str | None:
    """Write versions, command and traceback of an error into a file; None where that fails."""
    lines = [
        f"penode {version('penode')}, Python {platform.python_version()}, {platform.platform()}\n",
        f"{' '.join(sys.argv)}\n\n",
        *traceback.format_exception(error),
    ]
    try:
        handle, path = tempfile.mkstemp(prefix="penode-failure-", suffix=".txt", text=True)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.writelines(lines)
    except OSError:
        return None
    return path


def left_out(what: str, error: Exception) -> str:
    """Log that a part could not be made, and return the sentence, with the file of details in it.

    ``what`` is its subject: ``"the section on parameters"``.
    """
    path = details_file(error)
    where = f"please send in {path}, which has the details" if path else "no details were written"
    sentence = f"{what[:1].upper()}{what[1:]} could not be made ({in_short(error)}); {where}."
    LOG.warning("%s", sentence)
    return sentence
