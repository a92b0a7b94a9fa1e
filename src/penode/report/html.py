"""Renders a document as one HTML file that needs no network, no fonts and no second file."""

import re
from collections.abc import Sequence
from functools import cache, partial
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np
from plotly.offline import get_plotlyjs

from penode.report import palette, panels
from penode.report.document import Block, Document, Figure, Section, Table, attempt, missing, named

if TYPE_CHECKING:
    from jinja2 import Environment

#: Arrays of more numbers are written in single precision.
_EXACT = 100


def render(document: Document) -> str:
    """Render a document, all its text escaped, as a complete HTML page, to be saved as UTF-8.

    A block that cannot be rendered is left out by name.
    """
    from markupsafe import Markup

    templates = _templates()
    macros: Any = templates.get_template("blocks.html").module
    plots: list[Markup] = []
    tables = count(1)

    def block(one: Block) -> str:
        if isinstance(one, Figure):
            plots.append(_script_json(one))
            return str(macros.figure(one, len(plots)))
        number = [next(tables)] if isinstance(one, Table) else []
        return str(getattr(macros, type(one).__name__.lower())(one, *number))

    def shown(one: Block) -> Markup:
        kind = {Figure: "picture", Table: "table"}.get(type(one), "part")
        what = named(kind, getattr(one, "title", ""))
        return Markup(attempt(what, partial(block, one), lambda why: macros.notice(missing(why))))

    return templates.get_template("page.html").render(
        document=document,
        sections=_anchored(document.sections),
        shown=shown,
        plots=plots,
        plotly=get_plotlyjs,
        roles=palette.ROLES,
        dark_twins=palette.dark_twins(),
    )


@cache
def _templates() -> "Environment":
    # Imported here, as most commands write no page.
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    options: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "autoescape": True}
    loader = PackageLoader("penode.report")
    made = Environment(loader=loader, undefined=StrictUndefined, **options)
    #: Places to break long names at.
    made.filters["breakable"] = lambda text: escape(text).replace("_", Markup("_<wbr>"))
    return made


def _script_json(figure: Figure) -> Any:
    """Return the plot as JSON that cannot end the script element it is in."""
    from jinja2.utils import htmlsafe_json_dumps

    for trace in figure.plot.data:
        for name in {"x", "y", "z"} & set(trace):
            drawn = np.asarray(trace[name])
            if drawn.dtype == np.float64 and drawn.size > _EXACT:
                trace[name] = panels.compact(drawn)
    return htmlsafe_json_dumps(figure.plot, dumps=lambda plot, **_: plot.to_json(engine="json"))


def _anchored(sections: Sequence[Section]) -> list[tuple[str, Section]]:
    """Return the sections beside names that no two of them share."""
    anchors: dict[str, Section | None] = {"answer": None, "palette": None}
    for section in sections:
        stem = re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-") or "section"
        names = (stem if k == 1 else f"{stem}-{k}" for k in count(1))
        anchors[next(name for name in names if name not in anchors)] = section
    return [(anchor, section) for anchor, section in anchors.items() if section]
