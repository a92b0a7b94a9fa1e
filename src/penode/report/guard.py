"""Parts of a report that cannot be made are left out by name; the rest of the page stands."""

from collections.abc import Callable
from typing import Any, TypeVar

import plotly.graph_objects as go

from penode.fit.left_out import left_out
from penode.report.document import Figure, Notice

Made = TypeVar("Made")
Instead = TypeVar("Instead")


def attempt(
    what: str, make: Callable[[], Made], otherwise: Callable[[str], Instead]
) -> Made | Instead:
    """Return a part of the report, or what takes its place where it cannot be made.

    ``otherwise`` makes the latter from the sentence that says what is left out, and why.
    """
    try:
        return make()
    except Exception as error:
        return otherwise(left_out(what, error))


def missing(sentence: str) -> Notice:
    """Return the notice in the place of a part that is left out."""
    return Notice("caution", "Left out", sentence)


def picture(title: str, caption: str, draw: Callable[..., go.Figure], *of: Any) -> Figure | Notice:
    """Return a figure, or a notice where it cannot be drawn; ``draw`` is called with ``of``."""
    what = f"the picture \N{LEFT DOUBLE QUOTATION MARK}{title}\N{RIGHT DOUBLE QUOTATION MARK}"
    return attempt(what, lambda: Figure(title, caption, draw(*of)), missing)
