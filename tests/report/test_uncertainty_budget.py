"""The budget in a report: a row a source, a bar a fraction of the variance, one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from penode.fit.outcome import Contribution, Estimate
from penode.report.document import Cell, Document, Row, Section, Table
from penode.report.html import render
from penode.report.uncertainty_budget import budget_sentence, uncertainty_budget

ROWS = (
    Contribution("gain of the currents", 4e-5, "0.4 %", "Calibrate."),
    Contribution("statistics of the residuals", 3e-5, "", "Record longer."),
    Contribution("delay of the voltage", 1e-6, "0.02 samples", "Measure it."),
    Contribution("prior of the learned map", 0.0),
)
STD = (16e-10 + 9e-10 + 1e-12) ** 0.5
R = Estimate.of(10e-3, STD, "ohm", budget=ROWS)


def texts(row):
    return [cell.text for cell in row.cells]


def test_a_row_a_source_with_what_was_assumed_and_its_fraction_of_the_variance(fit):
    fit.parameters = {"R": R}
    (table,) = uncertainty_budget(fit).blocks
    assert table.columns[2] == "contribution to R in µΩ"
    assert [texts(row) for row in table.rows] == [
        ["gain of the currents", "0.4 %", "40", "64 %", "Calibrate."],
        ["statistics of the residuals", "from the data", "30", "36 %", "Record longer."],
        ["delay of the voltage", "0.02 samples", "1.0", "< 1 %", "Measure it."],
    ]
    assert table.rows[0].cells[3].value == pytest.approx(0.64, rel=1e-3)


def test_sensors_are_not_spoken_of_where_nothing_was_assumed(fit):
    shown = Estimate.of(10e-3, 3e-5, "ohm", budget=ROWS[1:2])
    fit.parameters = {"R": shown, "old": Estimate.of(1.0, 0.1, "ohm")}
    section = uncertainty_budget(fit)
    assert "sensors" not in section.lead
    assert [row.cells[0].text for table in section.blocks for row in table.rows] == [ROWS[1].source]
    assert budget_sentence(shown) == budget_sentence(fit.parameters["old"]) == ""
    fit.parameters = {"old": Estimate.of(1.0, 0.1, "ohm")}
    assert uncertainty_budget(fit) is None
    fit.parameters = {"R": R}
    assert "assumed of the sensors" in uncertainty_budget(fit).lead


def test_the_sentence_names_the_main_contributions():
    assert budget_sentence(R) == (
        "half width 0.98 %: gain of the currents 0.78 % (std 0.4 %), the data alone 0.59 %"
    )
    # Where zero is in the interval, per cent would be thousands.
    for value in (0.0, R.std):
        assert budget_sentence(replace(R, value=value)) == (
            "half width 98 µΩ: gain of the currents 78 µΩ (std 0.4 %), the data alone 59 µΩ"
        )


@pytest.mark.parametrize("origin", ["assumed", "declared", "estimated"])
def test_where_an_accuracy_is_from_stands_beside_it(fit, origin):
    rows = (replace(ROWS[0], origin=origin), *ROWS[1:])
    named = replace(R, budget=rows)
    fit.parameters = {"R": named}
    (table,) = uncertainty_budget(fit).blocks
    assert table.rows[0].cells[1].text == f"0.4 % {origin}"
    sentence = budget_sentence(named)
    assert f"gain of the currents 0.78 % (std 0.4 % {origin})" in sentence
    assert sentence.endswith("under [accuracy]") == (origin == "assumed")
    assert named.sensor_std == (0.0 if origin == "estimated" else pytest.approx(4e-5))


def test_the_sentence_calls_no_probability_a_deviation():
    doubt = replace(ROWS[0], source="tail of the dead time", accuracy="left out, 3 % probable")
    sentence = budget_sentence(replace(R, budget=(doubt, *ROWS[1:])))
    assert "tail of the dead time 0.78 % (left out, 3 % probable)" in sentence


def test_what_the_data_show_leaves_out_what_was_assumed():
    assert R.statistical_std == pytest.approx(3e-5)
    low, high = R.statistical_interval_95
    assert (low, high) == pytest.approx((10e-3 - 5.88e-5, 10e-3 + 5.88e-5))
    plain = Estimate.of(1.0, 0.1, "ohm")
    assert plain.statistical_std == 0.1
    assert plain.statistical_interval_95 == plain.interval_95


@pytest.mark.parametrize(("fraction", "width"), [(0.25, "25.0%"), (0.0, "0.0%"), (1.7, "100.0%")])
def test_a_bar_is_as_wide_as_its_fraction(fraction, width):
    rows = (Row((Cell("source"), Cell("shown", fraction, "bar"))),)
    table = Table("Budget", ("source", "fraction"), rows)
    page = render(Document("Kind", "Title", "Lead", [], [Section("Part", "Lead", [table])]))
    assert f'<span class="bar"><span style="width:{width}"></span></span>' in page
    assert '<th scope="col" class="number">fraction</th>' in page


@pytest.mark.parametrize(("size", "named"), [(0.21, True), (0.19, False)])
def test_a_source_is_named_from_a_fifth_of_the_largest_contribution_up(size, named):
    """The largest may be what the data show."""
    rows = (Contribution("statistics", 1e-4), Contribution("delay", size * 1e-4, "0.1 samples"))
    sentence = budget_sentence(Estimate.of(-10e-3, 1.02e-4, "ohm", budget=rows))
    assert ("delay" in sentence) == named
    assert sentence.startswith("half width 2.0 %: ")
    assert sentence.endswith("the data alone 2.0 %")


def test_what_is_unbounded_has_all_of_the_variance(fit):
    """As statistics are where the recordings are too short to show them."""
    rows = (Contribution("statistics", np.inf), Contribution("delay", 1e-6, "0.1 samples"))
    fit.parameters = {"R": Estimate.of(10e-3, np.inf, "ohm", budget=rows)}
    (table,) = uncertainty_budget(fit).blocks
    assert [texts(row)[2:4] for row in table.rows] == [["∞", "100 %"], ["1.0", "< 1 %"]]
    assert [row.cells[3].value for row in table.rows] == [1.0, 0.0]


def test_a_percent_is_the_least_that_is_shown_as_one(fit):
    rows = [Contribution(name, std) for name, std in (("a", 0.99), ("b", 0.1002), ("c", 0.0998))]
    whole = Estimate.of(1.0, 1.0, "ohm", budget=tuple(rows))
    fit.parameters = {"R": replace(whole, budget=tuple(rows))}
    (table,) = uncertainty_budget(fit).blocks
    assert [texts(row)[3] for row in table.rows] == ["98 %", "1 %", "< 1 %"]
    assert "1.96 times their root sum of squares" in table.caption
