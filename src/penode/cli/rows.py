"""Labelled sentences: a table on a terminal, a line each in a pipe."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

_STYLES = {"warning": "bold yellow"}


def print_rows(console: Console, rows: Sequence[tuple[str, str | Text]]) -> None:
    """Print labels with their values, nothing in which is taken for markup.

    On a terminal long sentences fold beside their label, and a repeated label is shown once; else
    every row is one line with its label, for programs that read lines.
    """
    width = max(len(label) for label, _ in rows)
    if not console.is_terminal:
        for label, text in rows:
            line = Text.assemble(f"{label:<{width}}  ", text)
            console.print(line, soft_wrap=True, highlight=False)
        return
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    previous = ""
    for label, text in rows:
        shown = "" if label == previous else label
        sentence = Text(text) if isinstance(text, str) else text
        table.add_row(Text(shown, style=_STYLES.get(label, "bold")), sentence)
        previous = label
    console.print(table, highlight=False)
