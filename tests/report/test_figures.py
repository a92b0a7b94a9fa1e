"""Figures hold the record's numbers, stay small and survive what diverged."""

import dataclasses
import itertools

import numpy as np
import pytest

from penode.report import panels
from penode.report.ladder import parameter_over_ladder
from penode.report.overlay import overlay, typical_window
from penode.report.spectrum import residual_spectrum
from penode.validation.comparison import Comparison


def points(figure, name):
    return next(trace for trace in figure.data if trace.name == name)


def test_ladder_shows_every_estimate_once_per_panel(fit):
    figure = parameter_over_ladder(fit, "mass")
    shown = {}
    for trace in figure.data:
        if trace.xaxis == "x" and trace.error_y.array is not None:
            shown |= dict(zip(trace.x, zip(trace.y, trace.error_y.array, strict=True), strict=True))
    assert sorted(shown) == [rung.horizon for rung in fit.horizon.ladder]
    for rung in fit.horizon.ladder:
        expected = (rung.parameters["mass"], 1.96 * rung.std["mass"])
        np.testing.assert_allclose(shown[rung.horizon], expected)


def test_ladder_marks_what_was_selected_and_the_interval(fit):
    figure = parameter_over_ladder(fit, "mass")
    assert list(points(figure, "selected, H = 50").x) == [50]
    assert list(points(figure, "horizons that agree").x) == [10, 20, 100]
    bands = [(shape.y0, shape.y1) for shape in figure.layout.shapes if shape.yref == "y"]
    assert bands == [fit.parameters["mass"].interval_95]


def test_ladder_enlarges_a_plateau_that_would_be_a_line(fit):
    figure = parameter_over_ladder(fit, "mass")
    low, high = figure.layout.yaxis2.range
    assert high - low < 0.1
    assert low < 1.010
    assert high > 1.026
    flat = dataclasses.replace(
        fit.horizon, ladder=fit.horizon.ladder[3:], plateau=(10, 20, 50, 100)
    )
    fit.horizon = flat
    assert "yaxis2" not in parameter_over_ladder(fit, "mass").layout.to_plotly_json()


def test_ladder_survives_unknown_deviations(fit):
    bad = dataclasses.replace(fit.horizon.ladder[0], std={"mass": np.inf})
    fit.horizon = dataclasses.replace(fit.horizon, ladder=(bad, *fit.horizon.ladder[1:]))
    low, high = parameter_over_ladder(fit, "mass").layout.yaxis.range
    assert np.isfinite([low, high]).all()


def test_ladder_of_one_rung(fit):
    fit.horizon = dataclasses.replace(
        fit.horizon, ladder=fit.horizon.ladder[5:6], plateau=(), verdict="fixed"
    )
    assert parameter_over_ladder(fit, "friction").layout.yaxis.title.text == "friction in Ns/m"


def test_overlay_has_values_and_errors_of_every_state(comparison):
    figure = overlay(comparison)
    titles = [figure.layout[panels.axis_key("y", panel)].title.text for panel in range(8)]
    assert titles[::2] == ["x in m", "error in m", "v in m/s", "error in m/s"]
    assert all(len(trace.x) <= 2100 for trace in figure.data)
    window = typical_window(comparison, 200)
    close = next(t for t in figure.data if t.xaxis == "x2" and t.name == "measured")
    np.testing.assert_allclose(close.y, comparison.measured[window, 0], rtol=1e-6)


def test_overlay_keeps_its_scale_when_the_free_run_diverges(comparison):
    free_run = comparison.free_run.copy()
    free_run[5000:5050] += np.exp(np.arange(50.0))[:, None]
    free_run[5050:] = np.nan
    lost = dataclasses.replace(comparison, free_run=free_run)
    figure = overlay(lost)
    assert np.ptp(figure.layout.yaxis.range) < 4
    assert any(note.text == "free run diverged" for note in figure.layout.annotations)


def test_overlay_of_a_run_that_diverged_at_once(comparison):
    lost = dataclasses.replace(comparison, free_run=np.full_like(comparison.free_run, np.nan))
    assert np.isfinite(overlay(lost).layout.yaxis.range).all()


def test_short_recording_has_no_close_up(comparison):
    parts = {name: getattr(comparison, name)[:300] for name in ("measured", "one_step", "free_run")}
    short = dataclasses.replace(comparison, **parts)
    assert typical_window(short, 200) is None
    assert {trace.xaxis for trace in overlay(short).data} == {"x", "x2", "x3", "x4"}


def test_envelope_keeps_every_extreme():
    values = np.random.default_rng(3).normal(size=30_011)
    chosen = panels.envelope(values, 2000)
    assert len(chosen) <= 2100
    assert {0, len(values) - 1, int(values.argmin()), int(values.argmax())} <= set(chosen.tolist())
    assert (np.diff(chosen) > 0).all()
    values[100:] = np.nan
    assert panels.envelope(values, 2000).tolist() == list(range(100))


def test_spectrum_keeps_its_line_and_marks_only_what_it_holds(spectrum):
    states = (("x", "m"), ("v", "m/s"))
    figure = residual_spectrum(spectrum, states, [(50.0, "6×"), (1e6, "12×")])
    trace = figure.data[0]
    assert len(trace.x) <= 2001
    assert max(trace.y) == pytest.approx(0.4)
    assert trace.x[int(np.argmax(trace.y))] == pytest.approx(50.0)
    assert [note.text for note in figure.layout.annotations] == ["6×"]


def test_spectrum_of_nothing(spectrum):
    silent = dataclasses.replace(spectrum, amplitude=np.zeros_like(spectrum.amplitude))
    assert residual_spectrum(silent, (("x", "m"), ("v", "m/s"))).data


@pytest.mark.parametrize("which", [0, 1, 2])
def test_narrow_pages_pile_the_panels_up(fit, which):
    figure = (
        parameter_over_ladder(fit, "mass"),
        overlay(fit.comparisons[0]),
        residual_spectrum(fit.spectrum, (("x", "m"), ("v", "m/s"))),
    )[which]
    narrow = figure.layout.meta["narrow"]
    axes = [entry for entry in narrow if entry.startswith("xaxis")]
    assert axes
    assert all(narrow[axis]["domain"] == [0, 1] for axis in axes)
    piles = sorted(narrow[axis.replace("x", "y", 1)]["domain"] for axis in axes)
    assert all(below[1] < above[0] for below, above in itertools.pairwise(piles))


def test_ladder_says_each_estimate_with_its_half_width(fit):
    figure = parameter_over_ladder(fit, "mass")
    assert list(points(figure, "selected, H = 50").text) == ["H = 50: 1.0180 ± 0.0078 kg"]
    grouped = [trace for trace in figure.data if trace.legendgroup == "horizons that agree"]
    assert [trace.showlegend for trace in grouped] == [True, False], "one entry for both panels"


def test_ladder_shades_a_plateau_only_where_the_data_answer(fit):
    shaded = [s for s in parameter_over_ladder(fit, "mass").layout.shapes if s.xref == "x"]
    assert [(s.x0 < 10, s.x1 > 100) for s in shaded] == [(True, True)]
    fit.horizon = dataclasses.replace(fit.horizon, verdict="no plateau")
    shapes = parameter_over_ladder(fit, "mass").layout.shapes
    assert [s for s in shapes if s.xref == "x"] == []


def test_a_huge_deviation_does_not_dwarf_the_estimates(fit):
    unsure = dataclasses.replace(fit.horizon.ladder[0], std={"mass": 1e3})
    fit.horizon = dataclasses.replace(fit.horizon, ladder=(unsure, *fit.horizon.ladder[1:]))
    low, high = parameter_over_ladder(fit, "mass").layout.yaxis.range
    assert low < 1.01
    assert high > 1.9
    assert high - low < 4


def test_ladder_has_round_ticks_within_its_horizons(fit):
    figure = parameter_over_ladder(fit, "mass")
    assert list(figure.layout.xaxis.tickvals) == [1, 2, 5, 10, 20, 50, 100]
    assert list(figure.layout.xaxis2.tickvals) == [10, 20, 50, 100]
    low, high = 10.0 ** np.array(figure.layout.xaxis.range)
    assert low < 1 < 100 < high < 200


def erring(levels, length):
    """Return a comparison whose free run errs by each level for a stretch of the length."""
    measured = np.sin(np.arange(len(levels) * length))[:, None]
    errors = np.repeat(levels, length)[:, None]
    return Comparison("r", "train", 0.1, ("x",), ("m",), measured, measured, measured + errors)


def test_the_close_up_errs_as_most_of_the_recording_does():
    """Neither the best stretch, nor the worst, nor that near a mean which one stretch makes."""
    seen = erring([1.0, 5.0, 2.0, 90.0, 3.0], 20)
    assert typical_window(seen, 20) == slice(80, 100)
    broken = seen.free_run.copy()
    broken[65:] = np.nan
    assert typical_window(dataclasses.replace(seen, free_run=broken), 20) == slice(40, 60)


def test_errors_are_predicted_less_measured_and_the_close_up_is_marked():
    seen = erring([1.0, 5.0, 3.0], 200)
    figure = overlay(seen)
    error = next(t for t in figure.data if t.xaxis == "x3" and t.name == "free run, error")
    np.testing.assert_allclose(error.y, np.repeat([1.0, 5.0, 3.0], 200), atol=1e-6)
    np.testing.assert_allclose(error.x, 0.1 * np.arange(600), rtol=1e-6)
    marks = [(s.x0, s.x1) for s in figure.layout.shapes]
    assert marks == [(40.0, 60.0)] * 2, "over the values and over the errors"
    assert figure.layout.xaxis2.range == pytest.approx((40.0, 59.9))
    close = next(t for t in figure.data if t.xaxis == "x2" and t.name == "measured")
    assert (close.x[0], close.x[-1]) == pytest.approx((40.0, 59.9))


def test_the_divergence_is_marked_where_it_begins(comparison):
    free_run = comparison.free_run.copy()
    free_run[5050:, 1] = np.inf
    figure = overlay(dataclasses.replace(comparison, free_run=free_run))
    lines = [s for s in figure.layout.shapes if s.type == "line"]
    assert [(s.x0, s.x1) for s in lines] == [(5.05, 5.05)] * 2, "of every state"


def test_a_state_that_nothing_predicts_is_drawn(comparison):
    nothing = np.full_like(comparison.measured, np.nan)
    lost = dataclasses.replace(comparison, one_step=nothing, free_run=nothing)
    assert np.isfinite(overlay(lost).layout.yaxis2.range).all()


def test_a_close_up_is_not_taken_over_by_a_free_run_that_explodes(comparison):
    free_run = comparison.free_run.copy()
    free_run[100:] += 1e38
    figure = overlay(dataclasses.replace(comparison, free_run=free_run))
    assert np.abs(figure.layout.yaxis2.range).max() < 10
    assert overlay(comparison).layout.yaxis2.range is None
