"""The section on how each horizon weighs the residual says and draws the numbers of the view."""

import dataclasses
import re

import numpy as np
import pytest

from penode.horizon.loss_weighting import loss_weighting
from penode.report.document import Figure, Notice, Table
from penode.report.loss_weighting import (
    weighting_figure,
    weighting_section,
    weighting_sentence,
)
from penode.validation.comparison import Comparison

STEP, SAMPLES = 1e-4, 20_000
TURN = 2 * np.pi * 100 * STEP
MATRICES = 0.998 * np.array([[[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]]])


def view_of(signal, units=("A", "A"), horizons=(1, 60), matrices=MATRICES):
    noise = 0.02 * np.random.default_rng(5).normal(size=(SAMPLES, 2))
    rows = np.column_stack([signal.real, signal.imag]) + noise
    comparison = Comparison("a.csv", "train", STEP, ("i_d", "i_q"), units, rows, 0 * rows, 0 * rows)
    return loss_weighting(comparison, matrices, horizons)


def named(view):
    return [(line, f"{line.frequency:.0f} Hz") for line in view.lines]


@pytest.fixture(scope="module")
def view():
    """A strong line far away and a weak one in the passband."""
    turn = 2j * np.pi * STEP * np.arange(SAMPLES)
    return view_of(np.exp(900 * turn) + 0.2 * np.exp(-105 * turn))


@pytest.fixture(scope="module")
def noise():
    return view_of(np.zeros(SAMPLES, dtype=complex))


def test_the_sentence_says_what_the_loss_at_each_horizon_consists_of(view):
    names = [(line, f"{round(line.frequency)} Hz") for line in view.lines]
    text = weighting_sentence(view, names).replace("\N{NO-BREAK SPACE}", " ")
    assert text.startswith("The largest part of the loss is the line at 900 Hz (96 %) at H = 1, ")
    assert re.search(r"the line at -105 Hz \(\d+ %\) at H = 60\.", text)
    assert re.search(
        r"to H = 60 the line at -105 Hz grows from [\d.]+ % to [\d.]+ %, and the line at", text
    )


def test_of_noise_the_sentence_is_short(noise):
    text = weighting_sentence(noise, []).replace("\N{NO-BREAK SPACE}", " ")
    assert text == "The loss at every horizon comes from noise without lines."


def test_the_section_has_a_figure_and_a_table_with_the_numbers(view):
    figure, table = weighting_section(view, ("A",)).blocks
    assert isinstance(figure, Figure)
    wanted = "Of all states together the residual has 2 lines, the strongest at 900"
    assert figure.title == f"{wanted}\N{NO-BREAK SPACE}Hz"
    assert isinstance(table, Table)
    assert table.columns[-1].startswith("fraction")
    for row, line in zip(table.rows, view.lines, strict=True):
        values = [cell.value for cell in row.cells[1:]]
        assert values == [line.frequency, line.amplitude, *view.fractions(line)]


def test_causes_have_a_column_where_they_are_known(view):
    table = weighting_section(view, ("A",), lambda _: ("n", "because")).blocks[1]
    assert table.columns[-1] == "likely causes"
    assert table.rows[0].cells[-1].text == "because"


def test_without_lines_there_is_no_table(noise):
    (figure,) = weighting_section(noise, ("A",)).blocks
    assert figure.title == "The residual has no lines"


def test_a_line_that_only_a_long_horizon_weighs_is_kept():
    """Eight at most are listed, by their largest fraction, not by amplitude."""
    turn = 2j * np.pi * STEP * np.arange(SAMPLES)
    far = sum(np.exp(f * turn) for f in range(1000, 2900, 200))
    view = view_of(far + 0.2 * np.exp(-105 * turn))
    assert round(view.lines[-1].frequency) == -105
    assert len(view.lines) == 11
    rows = weighting_section(view, ("A",)).blocks[1].rows
    assert len(rows) == 8
    assert round(rows[-1].cells[1].value) == -105


def test_weights_are_drawn_over_their_mean(view):
    figure = weighting_figure(view, named(view), ("A",))
    curves = {trace.name: trace for trace in figure.data}
    assert set(curves) == {"residual", "H = 1", "H = 60"}
    assert np.allclose(curves["H = 1"].y, 1.0)
    relative = view.weight[1, :, 0] / view.weight[1].mean()
    assert max(curves["H = 60"].y) == pytest.approx(relative.max(), rel=0.05)
    assert curves["residual"].y.max() == pytest.approx(np.sqrt(view.power.max()), rel=1e-6)
    assert all(len(trace.x) <= 3001 for trace in figure.data)
    assert len(figure.layout.shapes) == 4


def test_states_of_two_units_have_two_panels_each():
    view = view_of(np.zeros(SAMPLES, dtype=complex), units=("m", "m/s"))
    figure = weighting_figure(view, named(view), ("m", "m/s"))
    titles = [figure.layout[f"yaxis{k}"].title.text for k in ("", 2, 3, 4)]
    assert titles == ["i<sub>d</sub> in m", "weight", "i<sub>q</sub> in m/s", "weight"]


# --- weights that are not available -------------------------------------------------------------


@pytest.fixture(scope="module")
def unstable():
    turn = 2j * np.pi * STEP * np.arange(SAMPLES)
    return view_of(np.exp(900 * turn), horizons=(1, 40, 60), matrices=3.0 * MATRICES)


def test_horizons_without_a_weight_are_named_and_the_others_shown(unstable):
    section = weighting_section(unstable, ("A",))
    said = section.lead.replace("\N{NO-BREAK SPACE}", " ")
    assert "the line at 900 Hz (100 %) at H = 1." in said
    assert "At H = 40 and H = 60 the weighting is not available, as the fitted model is un" in said
    assert "grows most" not in said
    figure, table = section.blocks
    assert [trace.name for trace in figure.plot.data] == ["residual", "H = 1"]
    assert [head for head in table.columns if head.startswith("fraction")] == [
        "fraction at H\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}1"
    ]
    assert "peaks" not in figure.caption


def test_a_weight_at_no_horizon_is_a_notice(unstable):
    (notice,) = weighting_section(unstable.at(np.array([False, True, True])), ("A",)).blocks
    assert isinstance(notice, Notice)
    assert notice.label == "Not available"
    said = notice.text.replace("\N{NO-BREAK SPACE}", " ")
    assert said.startswith("At H = 40 and H = 60 the weighting is not available")


def test_a_residual_that_is_not_finite_is_a_notice(unstable):
    broken = dataclasses.replace(unstable, power=np.full_like(unstable.power, np.nan), lines=())
    (notice,) = weighting_section(broken, ("A",)).blocks
    assert "the one-step residual is not finite" in notice.text
