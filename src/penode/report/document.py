"""A report as records: sections of notices, key values, figures and tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    import plotly.graph_objects as go

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
