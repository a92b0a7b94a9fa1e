"""Parts of a report that fail are left out by name, and the rest of the page stands."""

import dataclasses
import logging
import re
from pathlib import Path

import numpy as np
import pytest

from penode.report import sections
from penode.report.document import Document, Figure, Section, attempt, picture
from penode.report.fit_report import PARTS, Page, fit_report
from penode.report.html import render


@pytest.fixture(autouse=True)
def details(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def failing(*_args, **_kwargs):
    raise ZeroDivisionError("float division by zero")


def titles(page):
    return re.findall(r"<h2 [^>]*>([^<]*)</h2>", page)


def left_out(page):
    return re.findall(r'<p class="label">Left out</p><p>([^<]*)</p>', page)


@pytest.fixture(scope="module")
def whole(oscillator):
    return titles(fit_report(oscillator.fit))


@pytest.mark.parametrize("at", range(len(PARTS)))
def test_a_section_that_fails_is_left_out_by_name(oscillator, whole, caplog, details, at):
    def broken(fit):
        return failing(fit)

    broken.__name__ = PARTS[at].__name__
    page = fit_report(oscillator.fit, Page(parts=(*PARTS[:at], broken, *PARTS[at + 1 :])))
    subject = broken.__name__.removesuffix("_section").replace("_", " ")
    assert titles(page) == [*whole[:at], subject.capitalize(), *whole[at + 1 :]]
    (sentence,) = left_out(page)
    assert sentence.startswith(f"The section on {subject} could not be made (ZeroDivisionError: ")
    assert [record.getMessage() for record in caplog.records] == [sentence]
    (written,) = details.iterdir()
    assert str(written) in sentence
    assert "in failing" in Path(written).read_text()


@pytest.mark.parametrize("name", ["overlay", "parameter_over_ladder", "residual_spectrum"])
def test_a_picture_that_fails_leaves_its_section(oscillator, whole, monkeypatch, caplog, name):
    before = fit_report(oscillator.fit)
    monkeypatch.setattr(sections, name, failing)
    page = fit_report(oscillator.fit)
    assert titles(page) == whole
    missed = left_out(page)
    assert missed
    assert all(one.startswith("The picture \N{LEFT DOUBLE QUOTATION MARK}") for one in missed)
    assert page.count("<figure ") == before.count("<figure ") - len(missed)
    assert page.count('class="table"') == before.count('class="table"')
    assert len(caplog.records) == len(missed)


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("verdict_notice", "Mass"),
        ("warning_notices", "Mass"),
        ("_key_values", "Mass"),
        ("_title", "Identification"),
        ("_first_paragraph", "Mass"),
    ],
)
def test_each_part_of_the_answer_stands_by_itself(oscillator, whole, monkeypatch, name, kept):
    monkeypatch.setattr(f"penode.report.fit_report.{name}", failing)
    page = fit_report(oscillator.fit, Page(headline=("mass",)))
    assert titles(page) == whole
    (heading,) = re.findall(r"<h1 [^>]*>([^<]*)</h1>", page)
    assert heading.startswith(kept)
    assert (name == "_title") != ("could not be made (ZeroDivisionError" in page)


class Unserialisable(dict):
    """A plot that plotly cannot write."""

    def to_json(self, engine):
        return failing()


def test_a_picture_that_cannot_be_written_is_left_out_and_the_numbers_close_up(oscillator):
    drawn = sections.predictions(oscillator.fit).blocks[-1]
    broken = Figure("It breaks <here>", "A caption.", Unserialisable())
    page = render(Document("K", "T", "L", [], [Section("S", "L", [broken, drawn])]))
    (sentence,) = left_out(page)
    assert "The picture \N{LEFT DOUBLE QUOTATION MARK}It breaks &lt;here&gt;" in sentence
    assert re.findall(r"<b>Figure (\d)[.]</b>", page) == ["1"]


def test_a_long_message_of_many_lines_is_cut_to_one():
    found = attempt("it", lambda: int("9\n" + "x" * 5000), str)
    assert len(found.splitlines()) == 1
    assert len(found) < 600


def test_where_no_details_can_be_written_that_is_said(monkeypatch):
    monkeypatch.setattr("tempfile.mkstemp", lambda **_: (_ for _ in ()).throw(OSError(28, "full")))
    assert "no details were written" in attempt("it", failing, str)


def test_ctrl_c_is_no_failure():
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        picture("a", "b", interrupted)


def test_a_good_report_logs_nothing(oscillator, caplog):
    with caplog.at_level(logging.DEBUG, "penode"):
        fit_report(dataclasses.replace(oscillator.fit, transitions=np.empty((0, 0, 0))))
    assert caplog.records == []
