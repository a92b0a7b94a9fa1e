"""Renders a document as one HTML file that needs no network, no fonts and no second file."""

import json
import re
from collections.abc import Sequence
from functools import partial
from html import escape
from importlib.resources import files
from itertools import count

from plotly.offline import get_plotlyjs

from penode.report import palette
from penode.report.document import (
    Block,
    Cell,
    Document,
    Figure,
    Glossary,
    KeyValue,
    KeyValues,
    Notice,
    Row,
    Section,
    Table,
)
from penode.report.guard import attempt, missing

#: The browser itself refuses whatever would be fetched.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; worker-src blob:"
)
#: Key values of more characters are set smaller.
_LONG = 14
#: Kinds of cells that are aligned as numbers.
_NUMERIC = ("number", "bar")
_PLOT_KEYS = "Keyboard: arrows move or turn the picture, plus and minus zoom, 0 resets."


def render(document: Document) -> str:
    """Render a document, all its text escaped, as a complete HTML page, to be saved as UTF-8."""
    return _Renderer().page(document)


class _Renderer:
    """Counts figures and tables while it renders them, and collects the figures' data."""

    def __init__(self) -> None:
        self._figures = count(1)
        self._tables = count(1)
        self._anchors = {"answer", "palette"}
        self._data: list[str] = []

    def page(self, document: Document) -> str:
        answer = self.blocks(document.answer)
        sections = [(self.anchor(section.title), section) for section in document.sections]
        body = "\n".join(self.section(anchor, section) for anchor, section in sections)
        links = "\n".join(
            f'<li><a href="#{anchor}">{escape(section.title)}</a></li>'
            for anchor, section in sections
        )
        return _PAGE.format(
            policy=_POLICY,
            title=escape(document.title),
            kind=escape(document.kind),
            lead=escape(document.lead),
            style=palette.custom_properties() + _resource("page.css"),
            links=links,
            answer=answer,
            sections=body,
            plotly=get_plotlyjs() if self._data else "",
            palette=_script_json(palette.dark_twins()),
            data="\n".join(self._data),
            script=_resource("page.js"),
        )

    def anchor(self, title: str) -> str:
        stem = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"
        anchor = stem
        for suffix in count(2):
            if anchor not in self._anchors:
                break
            anchor = f"{stem}-{suffix}"
        self._anchors.add(anchor)
        return anchor

    def section(self, anchor: str, section: Section) -> str:
        return (
            f'<section id="{anchor}" aria-labelledby="{anchor}-title">\n'
            f'<h2 id="{anchor}-title">{escape(section.title)}</h2>\n'
            f'<p class="lead">{escape(section.lead)}</p>\n'
            f"{self.blocks(section.blocks)}\n</section>"
        )

    def blocks(self, blocks: Sequence[Block]) -> str:
        return "\n".join(
            attempt(_named(block), partial(self.block, block), lambda why: _notice(missing(why)))
            for block in blocks
        )

    def block(self, block: Block) -> str:
        match block:
            case Notice():
                return _notice(block)
            case KeyValues():
                return _key_values(block.items)
            case Figure():
                return self.figure(block)
            case Table():
                return self.table(block)
            case Glossary():
                return _glossary(block)

    def figure(self, figure: Figure) -> str:
        content = _script_json(figure.plot.to_json(engine="json"))
        height = int(figure.plot.layout.height or 420)
        number = next(self._figures)
        name = f"figure-{number}"
        self._data.append(f'<script type="application/json" id="{name}-data">{content}</script>')
        return (
            f'<figure id="{name}">\n<div class="head">'
            f'<h3 id="{name}-title">{escape(figure.title)}</h3>'
            f'<div class="tools" role="group" aria-label="Figure {number}"></div></div>\n'
            f'<div class="plot" data-plot="{name}-data" style="min-height:{height}px" tabindex="0" '
            f'role="group" aria-roledescription="interactive figure" '
            f'aria-labelledby="{name}-title" aria-describedby="{name}-caption" '
            f'data-keys="{_PLOT_KEYS}">'
            f"<noscript>This picture needs JavaScript; the tables hold the numbers.</noscript>"
            f"</div>\n"
            f'<figcaption id="{name}-caption"><b>Figure {number}.</b> {escape(figure.caption)}'
            f"</figcaption>\n</figure>"
        )

    def table(self, table: Table) -> str:
        number = next(self._tables)
        name = f"table-{number}"
        numeric = [
            any(row.cells[column].kind in _NUMERIC for row in table.rows)
            for column in range(len(table.columns))
        ]
        heads = "".join(
            f'<th scope="col"{_class("number", is_number)}>{_breakable(head)}</th>'
            for head, is_number in zip(table.columns, numeric, strict=True)
        )
        caption = f"<p>{escape(table.caption)}</p>" if table.caption else ""
        rows = "\n".join(_row(row) for row in table.rows)
        return (
            f'<div class="table" id="{name}">\n<h3 id="{name}-title">{escape(table.title)}</h3>\n'
            f"{caption}\n"
            f'<div class="scroll" tabindex="0" role="region" aria-labelledby="{name}-title">'
            f'<table aria-labelledby="{name}-title">\n<thead><tr>{heads}</tr></thead>\n<tbody>\n'
            f"{rows}\n</tbody></table></div>\n</div>"
        )


def _named(block: Block) -> str:
    title = getattr(block, "title", "")
    kind = {Figure: "picture", Table: "table"}.get(type(block), "part")
    return f"the {kind} \N{LEFT DOUBLE QUOTATION MARK}{title}\N{RIGHT DOUBLE QUOTATION MARK}"


def _notice(notice: Notice) -> str:
    points = "".join(f"<li>{escape(point)}</li>" for point in notice.points)
    listing = f"<ul>{points}</ul>" if points else ""
    return (
        f'<div class="notice {notice.tone}" role="note">'
        f'<p class="label">{escape(notice.label)}</p>'
        f"<p>{escape(notice.text)}</p>{listing}</div>"
    )


def _key_values(items: Sequence[KeyValue]) -> str:
    listing = "\n".join(_key_value(item) for item in items)
    return f'<dl class="keys">{listing}</dl>'


def _key_value(item: KeyValue) -> str:
    return (
        f"<div{_class('doubtful', item.doubtful)}><dt>{escape(item.label)}</dt>"
        f'<dd class="{_value_class(item.text)}">{_data(item.text, item.value)}</dd>'
        f'<dd class="detail">{escape(item.detail)}</dd></div>'
    )


def _value_class(text: str) -> str:
    return "value long" if len(text) > _LONG else "value"


def _glossary(glossary: Glossary) -> str:
    terms = "".join(
        f"<dt>{escape(term)}</dt><dd>{escape(meaning)}</dd>" for term, meaning in glossary.terms
    )
    return (
        f'<details class="glossary"><summary>{escape(glossary.title)}</summary>'
        f"<dl>{terms}</dl></details>"
    )


def _row(row: Row) -> str:
    first, *rest = row.cells
    mark = f'<span class="mark">{escape(row.mark)}</span> ' if row.mark else ""
    head = f'<th scope="row"{_kind_class(first)}>{mark}{_cell(first)}</th>'
    cells = "".join(f"<td{_kind_class(cell)}>{_cell(cell)}</td>" for cell in rest)
    return f"<tr{_class('marked', bool(row.mark))}>{head}{cells}</tr>"


def _cell(cell: Cell) -> str:
    if cell.kind == "code":
        return f"<code>{_breakable(cell.text)}</code>"
    text = _breakable(cell.text) if cell.value is None else _data(cell.text, cell.value)
    if cell.kind == "bar":
        width = f"{100 * min(max(cell.value or 0.0, 0.0), 1.0):.1f}%"
        return f'<span class="bar"><span style="width:{width}"></span></span>{text}'
    return text


def _breakable(text: str) -> str:
    """Return the text with places to break long names at."""
    return escape(text).replace("_", "_<wbr>")


def _data(text: str, value: float | None) -> str:
    return (
        escape(text) if value is None else f'<data value="{float(value)!r}">{escape(text)}</data>'
    )


def _kind_class(cell: Cell) -> str:
    return _class("number", cell.kind in _NUMERIC)


def _class(name: str, wanted: bool) -> str:
    return f' class="{name}"' if wanted else ""


def _script_json(content: object) -> str:
    """Return JSON that cannot end the script element it is in."""
    text = content if isinstance(content, str) else json.dumps(content)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _resource(name: str) -> str:
    return files("penode.report").joinpath(name).read_text(encoding="utf-8")


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<a class="skip" href="#answer">Skip to the answer</a>
<div class="frame">
<nav aria-label="Contents">
<p class="brand">penode</p>
<ol>
<li><a href="#answer">Answer</a></li>
{links}
</ol>
</nav>
<main>
<section id="answer" aria-labelledby="answer-title" tabindex="-1">
<header>
<p class="kind">{kind}</p>
<h1 id="answer-title">{title}</h1>
<p class="lead">{lead}</p>
</header>
{answer}
</section>
{sections}
</main>
</div>
<script>{plotly}</script>
<script type="application/json" id="palette">{palette}</script>
{data}
<script>
{script}</script>
</body>
</html>
"""
