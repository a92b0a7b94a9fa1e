"""The section on what each horizon listens to says and draws the numbers of the view."""

import numpy as np
import pytest

from penode.horizon.loss_weighting import loss_weighting
from penode.report.document import Figure, Table
from penode.report.listening import listening
from penode.report.loss_weighting import Name, prefilter_figure, prefilter_section, unnamed
from penode.validation.comparison import Comparison

STEP, SAMPLES = 1e-4, 20_000
TURN = 2 * np.pi * 100 * STEP
MATRICES = 0.998 * np.array([[[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]]])


def view_of(signal, units=("A", "A"), horizons=(1, 60)):
    noise = 0.02 * np.random.default_rng(5).normal(size=(SAMPLES, 2))
    rows = np.column_stack([signal.real, signal.imag]) + noise
    comparison = Comparison("a.csv", "train", STEP, ("i_d", "i_q"), units, rows, 0 * rows, 0 * rows)
    return loss_weighting(comparison, MATRICES, horizons)


@pytest.fixture(scope="module")
def view():
    """A strong line far away and a weak one in the passband."""
    turn = 2j * np.pi * STEP * np.arange(SAMPLES)
    return view_of(np.exp(900 * turn) + 0.2 * np.exp(-105 * turn))


@pytest.fixture(scope="module")
def noise():
    return view_of(np.zeros(SAMPLES, dtype=complex))


def test_the_sentence_says_what_each_horizon_listens_to(view):
    names = [(line, f"{round(line.frequency)} Hz") for line in view.lines]
    text = listening(view, names).replace("\N{NO-BREAK SPACE}", " ")
    assert text.startswith(
        "At H = 1 the fit listens mostly to the line at 900 Hz (96 %); at H = 60"
    )
    assert "at H = 60 to the line at -105 Hz" in text
    assert "it turns most to the line at -105 Hz" in text


def test_of_noise_the_sentence_is_short(noise):
    text = listening(noise, []).replace("\N{NO-BREAK SPACE}", " ")
    assert text == (
        "At H = 1 the fit listens mostly to noise without lines (100 %); at H = 60 to noise "
        "without lines (100 %)."
    )


def test_the_section_has_a_figure_and_a_table_with_the_numbers(view):
    figure, table = prefilter_section(view, unnamed(view)).blocks
    assert isinstance(figure, Figure)
    assert (
        figure.title
        == "2 lines stand out of the residual, the strongest at 900\N{NO-BREAK SPACE}Hz"
    )
    assert isinstance(table, Table)
    assert table.columns[-1].startswith("share")
    for row, line in zip(table.rows, view.lines, strict=True):
        values = [cell.value for cell in row.cells[1:]]
        assert values == [line.frequency, line.amplitude, *view.shares(line)]


def test_causes_have_a_column_where_they_are_known(view):
    names = [Name(line, "n", "because") for line in view.lines]
    table = prefilter_section(view, names).blocks[1]
    assert table.columns[-1] == "likely causes"
    assert table.rows[0].cells[-1].text == "because"


def test_without_lines_there_is_no_table(noise):
    (figure,) = prefilter_section(noise, unnamed(noise)).blocks
    assert figure.title == "No line stands out of the residual"


def test_a_line_that_only_a_long_horizon_hears_is_kept():
    """Eight at most are told, by their largest share: not only the strongest of the residual."""
    turn = 2j * np.pi * STEP * np.arange(SAMPLES)
    far = sum(np.exp(f * turn) for f in range(1000, 2900, 200))
    view = view_of(far + 0.2 * np.exp(-105 * turn))
    assert round(view.lines[-1].frequency) == -105
    assert len(view.lines) == 11
    rows = prefilter_section(view, unnamed(view)).blocks[1].rows
    assert len(rows) == 8
    assert round(rows[-1].cells[1].value) == -105


def test_weights_are_drawn_over_their_mean(view):
    figure = prefilter_figure(view, unnamed(view))
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
    figure = prefilter_figure(view, unnamed(view))
    titles = [figure.layout[f"yaxis{k}"].title.text for k in ("", 2, 3, 4)]
    assert titles == ["i<sub>d</sub>", "weight", "i<sub>q</sub>", "weight"]
