"""A report as records: sections of notices, key values, figures and tables.

Parts that cannot be made are left out by name; the rest of the page stands.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from penode.fit.left_out import left_out

if TYPE_CHECKING:
    import plotly.graph_objects as go

Made = TypeVar("Made")
Instead = TypeVar("Instead")
Tone: TypeAlias = Literal["good", "caution", "refusal"]


@dataclass(frozen=True)
class Notice:
    """A coloured box with the one thing to know: a word or two, a sentence, further points."""

    tone: Tone
    label: str
    text: str
    points: tuple[str, ...] = ()


@dataclass(frozen=True)
class KeyValue:
    """One number large enough to read across a desk; ``value``, SI, is for machines to read."""

    label: str
    text: str
    detail: str = ""
    value: float | None = None
    doubtful: bool = False


@dataclass(frozen=True)
class KeyValues:
    """Key values side by side."""

    items: tuple[KeyValue, ...]


@dataclass(frozen=True, eq=False)
class Figure:
    """One picture.

    ``plot.layout.meta["narrow"]``, where present, holds the layout entries that change on a narrow
    page.
    """

    title: str
    caption: str
    plot: "go.Figure"


@dataclass(frozen=True)
class Cell:
    """One entry of a table; ``value`` is the number behind the text in SI units, where it is one.

    A ``"bar"`` stands beside a bar of the fraction; ``"code"`` is verbatim.
    """

    text: str
    value: float | None = None
    kind: Literal["text", "number", "bar", "code"] = "text"


@dataclass(frozen=True)
class Row:
    """One row of a table, headed by its first cell, beside which ``mark`` is shown."""

    cells: tuple[Cell, ...]
    mark: str = ""


@dataclass(frozen=True)
class Table:
    """Rows under headed columns, units included in the heads."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    caption: str = ""


@dataclass(frozen=True)
class Glossary:
    """Words and their explanations, folded under the title until asked for."""

    title: str
    terms: tuple[tuple[str, str], ...]


Block: TypeAlias = Notice | KeyValues | Figure | Table | Glossary


@dataclass(frozen=True, eq=False)
class Section:
    """A headed part of the document: a paragraph, then blocks in order."""

    title: str
    lead: str
    blocks: Sequence[Block]


@dataclass(frozen=True, eq=False)
class Document:
    """A whole report; ``answer`` is what must be seen before any section."""

    kind: str
    title: str
    lead: str
    answer: Sequence[Block]
    sections: Sequence[Section]


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


def picture(
    title: str, caption: str, draw: "Callable[..., go.Figure]", *of: Any
) -> Figure | Notice:
    """Return a figure, or a notice where it cannot be drawn; ``draw`` is called with ``of``."""
    return attempt(named("picture", title), lambda: Figure(title, caption, draw(*of)), missing)


def named(kind: str, title: str) -> str:
    """Return a part of the report as it stands in a sentence."""
    return f"the {kind} \N{LEFT DOUBLE QUOTATION MARK}{title}\N{RIGHT DOUBLE QUOTATION MARK}"
