"""What the site needs beyond Markdown and theme: formulas as MathML, a name of the search."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\(?P<open>[(\[])(?P<latex>.*?)\\[)\]]</(?P=tag)>',
    re.DOTALL,
)


def on_page_content(content: str, **_: Any) -> str:
    """Replace the formulas of a page, marked by arithmatex, with MathML."""
    return _FORMULA.sub(_formula, content)


def on_post_page(output: str, **_: Any) -> str:
    """Give the theme's search its name."""
    return output.replace('role="dialog"', 'role="dialog" aria-label="Search"')


def _formula(found: re.Match[str]) -> str:
    display = "block" if found["open"] == "[" else "inline"
    return convert(html.unescape(found["latex"]), display=display)
