"""What is said on the terminal: labelled rows, sentences, and why a command could not end well."""

import logging
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from penode.errors import InputError
from penode.fit.left_out import details_file, in_short

OUTPUT, ERRORS = Console(emoji=False), Console(stderr=True, emoji=False)
#: A label and its value; nothing in a value is taken for markup.
Row = tuple[str, str | Text]
_STYLES = {"warning": "bold yellow"}
#: Exit status of a failure inside penode (EX_SOFTWARE of sysexits.h).
_FAILED = 70


class Interrupted(Exception):  # noqa: N818 (a request, not an error)
    """A person left at once; the message says what remains."""


def say(text: str) -> None:
    """Print a sentence on standard error, a line whatever the terminal's width."""
    ERRORS.print(text, soft_wrap=True, highlight=False, markup=False)


def print_rows(rows: Sequence[Row], console: Console = OUTPUT, below: Iterable[str] = ()) -> None:
    """Print labels with their values, in line with labels that they are printed below.

    On a terminal long sentences fold beside their label, and a repeated label is shown once; else
    every row is one line with its label, for programs that read lines.
    """
    width = max(map(len, [*(label for label, _ in rows), *below]))
    if not console.is_terminal:
        for label, text in rows:
            line = Text.assemble(f"{label:<{width}}  ", text)
            console.print(line, soft_wrap=True, highlight=False)
        return
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True, min_width=width)
    table.add_column(overflow="fold")
    before = ["", *(label for label, _ in rows)]
    for (label, text), previous in zip(rows, before, strict=False):
        shown = Text("" if label == previous else label, style=_STYLES.get(label, "bold"))
        table.add_row(shown, Text(text) if isinstance(text, str) else text)
    console.print(table, highlight=False)


def why_and_status(error: Exception) -> tuple[str, int]:
    """Return why a command failed, as a sentence, and its exit status.

    The details of a failure that no command expects are written into a file, which is named.
    """
    if isinstance(error, InputError):
        return str(error), 2
    if isinstance(error, OSError):
        return _of_the_system(error), 2
    if isinstance(error, MemoryError):
        what = f" ({error})" if str(error) else ""
        return f"not enough memory{what}; ask for less, or record for a shorter time.", 2
    path = details_file(error)
    details = (
        f"please send in {path}, which has the details" if path else "no details could be written"
    )
    return f"an internal error of penode ({in_short(error)}); {details}.", _FAILED


def _of_the_system(error: OSError) -> str:
    what = f"{error.filename}: " if error.filename else ""
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return f"{what}a file is there where a folder was wanted; give another place."
    reason = error.strerror or str(error)
    return (
        f"{what}{reason[:1].lower()}{reason[1:]}; give another place, or correct its permissions "
        "or free some space."
    )


class Notes(logging.Handler):
    """Prints what is left out of a result as a note on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one."""
        say(f"note: {record.getMessage()}")
