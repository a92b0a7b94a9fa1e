"""A report as records: sections of notices, key values, figures and tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import plotly.graph_objects as go

Tone: TypeAlias = Literal["good", "caution", "refusal"]


@dataclass(frozen=True)
class Notice:
    """A coloured box with the one thing to know.

    Attributes
    ----------
    tone : {"good", "caution", "refusal"}
        What it means for the reader; also in words by ``label``.
    label : str
        One or two words, such as ``"Answered"``.
    text : str
        The sentence that matters.
    points : tuple of str
        Further sentences, shown as a list.
    """

    tone: Tone
    label: str
    text: str
    points: tuple[str, ...] = ()


@dataclass(frozen=True)
class KeyValue:
    """One number large enough to read across a desk.

    Attributes
    ----------
    label, text, detail : str
        What it is, the number with its unit, and a line of explanation.
    value : float or None
        The number itself in SI units, kept in the page for machines to read.
    doubtful : bool
        Whether the number must not be used as it is.
    """

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

    Attributes
    ----------
    title : str
        What the picture says.
    caption : str
        How to read it.
    plot : plotly.graph_objects.Figure
        The picture. ``layout.meta["narrow"]``, where present, holds the layout entries that change
        when the page is narrow.
    """

    title: str
    caption: str
    plot: go.Figure


@dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Attributes
    ----------
    text : str
        What is shown.
    value : float or None
        The number behind the text in SI units, where it is one.
    kind : {"text", "number", "bar", "code"}
        How it is set: plain, aligned to the right, beside a bar of the fraction, or verbatim.
    """

    text: str
    value: float | None = None
    kind: Literal["text", "number", "bar", "code"] = "text"


@dataclass(frozen=True)
class Row:
    """One row of a table; the first cell heads it.

    Attributes
    ----------
    cells : tuple of Cell
        One per column.
    mark : str
        Why the row is marked (``"selected"``), shown beside its first cell.
    """

    cells: tuple[Cell, ...]
    mark: str = ""


@dataclass(frozen=True)
class Table:
    """Rows under headed columns.

    Attributes
    ----------
    title : str
        What the table holds.
    columns : tuple of str
        Heads, units included.
    rows : tuple of Row
        Contents.
    caption : str
        How to read it.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    caption: str = ""


@dataclass(frozen=True)
class Glossary:
    """Words explained, folded until asked for.

    Attributes
    ----------
    title : str
        Line that unfolds it.
    terms : tuple of (str, str)
        Word and explanation.
    """

    title: str
    terms: tuple[tuple[str, str], ...]


Block: TypeAlias = Notice | KeyValues | Figure | Table | Glossary


@dataclass(frozen=True, eq=False)
class Section:
    """A headed part of the document.

    Attributes
    ----------
    title : str
        Heading, and entry of the contents.
    lead : str
        Paragraph under the heading.
    blocks : sequence of Block
        Contents in order.
    """

    title: str
    lead: str
    blocks: Sequence[Block]


@dataclass(frozen=True, eq=False)
class Document:
    """A whole report.

    Attributes
    ----------
    kind : str
        What sort of report, above the heading.
    title : str
        The answer in one line.
    lead : str
        Paragraph under it.
    answer : sequence of Block
        What must be seen before any section.
    sections : sequence of Section
        The rest, in order.
    """

    kind: str
    title: str
    lead: str
    answer: Sequence[Block]
    sections: Sequence[Section]
