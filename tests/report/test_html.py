"""The page: every kind of block, escaped, with unique anchors, dark twins and no library unused."""

import base64
import json
import re

import numpy as np
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


def test_figures_and_tables_are_numbered_from_the_top_of_the_page():
    """The answer stands above the sections, so its figure is the first."""
    first, second = (Figure(t, "C", panels.blank_figure()) for t in ("On top", "Below"))
    table = Table("T", ("name",), ())
    part = Section("Part", "Lead", [second, table, table])
    page = render(Document("Kind", "Title", "Lead", [first], [part]))
    titles = dict(re.findall(r'<h3 id="figure-(\d)-title">([^<]*)</h3>', page))
    assert titles == {"1": "On top", "2": "Below"}
    assert re.findall(r"<b>Figure (\d)\.</b>", page) == ["1", "2"]
    assert re.findall(r'<div class="table" id="table-(\d)">', page) == ["1", "2"]
    data = set(re.findall(r'<script type="application/json" id="([^"]*-data)">', page))
    assert data == set(re.findall(r'data-plot="([^"]*)"', page))


def test_wide_tables_that_are_short_or_end_in_a_sentence_are_records_on_a_phone():
    heads = ("a", "b in <V>", "c", "d")
    numbers = tuple(Cell(str(k), float(k), "number") for k in range(4))
    words = (*numbers[:3], Cell("why"))
    cases = {
        (numbers, 9): "wide",
        (numbers, 3): "wide records",
        (words, 9): "wide records",
        (numbers[:3], 2): "",
    }
    for (cells, count), shape in cases.items():
        page = render(document(Table("T", heads[: len(cells)], (Row(cells),) * count)))
        (found,) = re.findall(r'<table aria-labelledby="table-1-title"(?: class="([^"]*)")?>', page)
        assert found == shape
        assert page.count('<td data-head="b in &lt;V&gt;"') == count


def test_room_is_kept_for_a_figure_before_it_is_drawn():
    tall, plain = panels.blank_figure().update_layout(height=777.4), panels.blank_figure()
    page = render(document(Figure("F", "C", tall), Figure("F", "C", plain)))
    assert re.findall(r'min-height:(\d+)px" tabindex', page) == ["777", "420"]


def test_doubt_length_and_marks_are_seen():
    values = KeyValues((KeyValue("a", "x" * 14), KeyValue("b", "x" * 15, doubtful=True)))
    rows = (Row((Cell("x"), Cell("1"))), Row((Cell("y"), Cell("2")), "selected"))
    page = render(document(values, Table("T", ("name", "value"), rows)))
    assert re.findall(r'<dd class="(value[^"]*)">', page) == ["value", "value long"]
    assert re.findall(r"<div( class=\"doubtful\")?><dt>(.)", page) == [
        ("", "a"),
        (' class="doubtful"', "b"),
    ]
    assert re.findall(r'<tr class="marked"><th scope="row">(.*?)</th>', page) == [
        '<span class="mark">selected</span> y'
    ]
    assert '<th scope="col" class="number">' not in page


def test_numbers_of_any_kind_are_written_as_plain_ones_and_long_names_may_break():
    row = Row((Cell("dead_time", kind="code"), Cell("10", np.float64(0.25), "number")))
    page = render(document(Table("T", ("name", "free_run"), (row,))))
    assert '<data value="0.25">10</data>' in page
    assert "<code>dead_<wbr>time</code>" in page
    assert "free_<wbr>run</th>" in page


def test_points_of_a_notice_are_a_list_only_where_there_are_some():
    plain, listed = (Notice("good", "L", "T", points) for points in ((), ("one", "two")))
    assert "<ul>" not in render(document(plain))
    assert "<ul><li>one</li><li>two</li></ul>" in render(document(listed))


def test_long_curves_are_written_in_single_precision_and_short_ones_as_they_are():
    plot = panels.blank_figure()
    plot.add_scatter(x=np.arange(300), y=np.linspace(-1e300, 1e300, 300), name="long")
    plot.add_scatter(x=[0.0, 1.0], y=np.array([1.0, 1.0 + 1e-9]), name="short")
    page = render(document(Figure("F", "C", plot)))
    (data,) = re.findall(r'id="figure-1-data">(.*?)</script>', page)
    long, short = json.loads(data)["data"]
    drawn = np.frombuffer(base64.b64decode(long["y"]["bdata"]), long["y"]["dtype"])
    assert drawn.dtype == np.float32
    assert np.isfinite(drawn).all()
    assert short["y"]["dtype"] == "f8"
