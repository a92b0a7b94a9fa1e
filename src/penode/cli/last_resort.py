"""The report on failures that no command expects: a sentence, an exit status, a file to send."""

import logging

from rich.console import Console

from penode.fit.left_out import details_file, in_short

#: Exit status of a failure inside penode (EX_SOFTWARE of sysexits.h).
FAILED = 70


def of_the_system(error: OSError) -> str:
    """Return a sentence on a file that could not be read or written."""
    what = f"{error.filename}: " if error.filename else ""
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return f"{what}a file is there where a folder was wanted; give another place."
    reason = error.strerror or str(error)
    return (
        f"{what}{reason[:1].lower()}{reason[1:]}; give another place, or mend its permissions or "
        "free some space."
    )


def of_memory(error: MemoryError) -> str:
    """Return a sentence on what does not fit into the memory."""
    what = f" ({error})" if str(error) else ""
    return f"the memory does not suffice{what}; ask for less, or record for a shorter time."


def of_penode(error: Exception) -> str:
    """Write the details of a failure into a file, and return a sentence that names it."""
    message = f"penode failed where it should not ({in_short(error)})"
    path = details_file(error)
    if path is None:
        return f"{message}; its details could not be written."
    return f"{message}; please send in {path}, which has the details."


class Notes(logging.Handler):
    """Prints what is left out of a result as a note on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one, a line whatever the terminal's width."""
        text = f"note: {record.getMessage()}"
        Console(stderr=True).print(text, soft_wrap=True, highlight=False, markup=False)
