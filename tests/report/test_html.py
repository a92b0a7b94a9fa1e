"""The page: every kind of block, escaped, with unique anchors, dark twins and no library unused."""

import re

import pytest

from penode.report import palette, panels
from penode.report.document import (
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
from penode.report.html import render

HOSTILE = '</script><img src=x onerror="alert(1)">&'


def document(*blocks, title="Title"):
    return Document("Kind", title, "Lead", [], [Section("Part", "Lead", blocks)])


@pytest.mark.parametrize(
    "block",
    [
        Notice("refusal", HOSTILE, HOSTILE, (HOSTILE,)),
        KeyValues((KeyValue(HOSTILE, HOSTILE, HOSTILE, 1.0),)),
        Table(HOSTILE, (HOSTILE,), (Row((Cell(HOSTILE, kind="code"),), HOSTILE),), HOSTILE),
        Glossary(HOSTILE, ((HOSTILE, HOSTILE),)),
    ],
    ids=["notice", "key values", "table", "glossary"],
)
def test_text_cannot_become_markup(block):
    page = render(document(block, title=HOSTILE))
    assert "<img" not in page
    assert "&lt;img" in page


def test_figure_cannot_end_its_script():
    plot = panels.blank_figure()
    plot.add_annotation(text=HOSTILE)
    page = render(document(Figure(HOSTILE, HOSTILE, plot)))
    assert "<img" not in page
    assert "\\u003cimg" in page


def test_plotly_stands_in_the_page_once_and_only_where_figures_are():
    figure = Figure("F", "C", panels.blank_figure())
    assert render(document(figure, figure)).count("plotly.js v") == 1
    assert "plotly.js v" not in render(document())


def test_sections_of_one_title_get_anchors_of_their_own():
    sections = [Section("Answer", "", []), Section("Part 1", "", []), Section("Part 1", "", [])]
    page = render(Document("Kind", "Title", "Lead", [], sections))
    anchors = re.findall(r'<section id="([^"]+)"', page)
    assert anchors == ["answer", "answer-2", "part-1", "part-1-2"]
    assert re.findall(r'href="#([^"]+)"', page)[-3:] == anchors[1:]


def test_numbers_carry_their_value():
    row = Row((Cell("R"), Cell("10.0", 0.01, "number")))
    page = render(document(Table("T", ("name", "value"), (row,))))
    assert '<data value="0.01">10.0</data>' in page
    assert '<th scope="col" class="number">value</th>' in page


def test_every_light_colour_has_one_dark_twin():
    twins = palette.dark_twins()
    colours = [value for value in vars(palette).values() if isinstance(value, palette.Colour)]
    assert all(twins[colour.light] == colour.dark for colour in (*colours, *palette.SEQUENCE))


def luminance(colour):
    channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    ("text", "ground"),
    [
        ("INK", "PAGE"), ("MUTED", "PAGE"), ("MUTED", "PANEL"), ("ACCENT", "PAGE"),
        ("ACCENT", "PANEL"), ("GOOD", "GOOD_FILL"), ("CAUTION", "CAUTION_FILL"),
        ("REFUSAL", "REFUSAL_FILL"), ("REFUSAL", "PAGE"), ("INK", "GOOD_FILL"),
        ("INK", "CAUTION_FILL"), ("INK", "REFUSAL_FILL"), ("MARKER_LINE", "PAGE"),
    ],
)  # fmt: skip
def test_text_stands_out_from_its_ground(text, ground, scheme):
    """Contrast of at least 4.5 to 1 (WCAG 2.2, 1.4.3)."""
    bright, dim = sorted(
        (luminance(getattr(getattr(palette, name), scheme)) for name in (text, ground)),
        reverse=True,
    )
    assert (bright + 0.05) / (dim + 0.05) >= 4.5
