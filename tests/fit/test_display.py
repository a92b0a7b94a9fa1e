"""A fit as text, as a table, as data frames and as figures."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from penode import InputError
from penode.fit.outcome import Estimate


@pytest.fixture(scope="module")
def fit(oscillator):
    return oscillator.fit


def test_the_text_has_parameters_with_intervals_horizon_and_errors(fit):
    text = repr(fit)
    first, mass, damping, seen, unseen, *_ = text.split("\n")
    assert first == (
        f"Fit of Duffing: H = {fit.horizon.selected}, {fit.horizon.verdict}. {fit.horizon.reason}"
    )
    low, high = (
        float(end) for end in mass.split("95 %")[1].split("identifiability")[0].split(" to ")
    )
    assert (low, high) == pytest.approx(fit.parameters["mass"].interval_95, rel=1e-3)
    assert mass.split()[:3:2] == ["mass", "kg"]
    assert "N s/m" in damping
    error = fit.comparisons[0].one_step_errors["x"]
    assert f"train.csv (train): x one step {error:.3g} m, free run" in seen
    assert "unseen.csv (validation)" in unseen


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (0.0123456, 0.00012, "0.01235 ohm"),
        (270.123e-9, 1.5e-9, "2.701e-07 ohm"),
        (-1234.5678, 20.0, "-1235 ohm"),
        (2.5, np.inf, "2.500 ohm"),
        (np.nan, np.nan, "nan ohm"),
    ],
)
def test_digits_follow_the_deviation(fit, value, std, shown):
    one = replace(fit, parameters={"R": Estimate.of(value, std, "ohm")})
    assert f"  R  {shown}  95 % " in repr(one)


def test_warnings_and_names_are_shown_and_escaped(fit):
    odd = replace(fit.comparisons[0], name="<run>.csv", units=("A", "A"))
    warned = replace(fit, warnings=("a < b.",), comparisons=(odd,))
    assert "  Warning: a < b." in repr(warned)
    page = warned._repr_html_()
    assert "a &lt; b." in page
    assert "&lt;run&gt;.csv" in page
    assert f"one step {odd.one_step_rmse:.3g} A" in page
    assert page.count("<tr>") == 2 + len(fit.parameters) + 1


def test_parameters_as_a_frame(fit):
    frame = fit.parameters_frame()
    assert frame["parameter"].to_list() == ["mass", "damping"]
    assert frame["value"].to_list() == [p.value for p in fit.parameters.values()]
    assert frame["high_95"].to_list() == [p.interval_95[1] for p in fit.parameters.values()]
    assert frame["unit"].to_list() == ["kg", "N s/m"]
    assert replace(fit, parameters={}).parameters_frame().height == 0


def test_the_ladder_as_a_frame(fit):
    frame = fit.ladder_frame()
    assert frame["horizon"].to_list() == [1, 2, 4, 8, 16]
    for rung, row in zip(fit.horizon.ladder, frame.iter_rows(named=True), strict=True):
        assert (row["mass"], row["mass_std"]) == (rung.parameters["mass"], rung.std["mass"])
        assert row["free_run_rmse_v"] == rung.free_run_errors["v"]
        assert row["selected"] == (rung.horizon == fit.horizon.selected)
    assert replace(fit, horizon=replace(fit.horizon, ladder=())).ladder_frame().height == 0


def test_predictions_as_a_frame(fit):
    comparison = fit.comparisons[0]
    frame = comparison.to_frame()
    assert frame.columns[:4] == ["time", "x", "x_one_step", "x_free_run"]
    np.testing.assert_allclose(np.diff(frame["time"]), comparison.time_step)
    np.testing.assert_array_equal(frame["v_free_run"], comparison.free_run[:, 1])


def test_the_ladder_is_drawn(fit):
    figure = fit.plot_ladder()
    mass, damping = figure.axes
    assert figure.get_suptitle().startswith(f"H = {fit.horizon.selected}")
    assert (mass.get_ylabel(), damping.get_ylabel()) == ("mass (kg)", "damping (N s/m)")
    points = mass.collections[-2].get_offsets()
    expected = [(rung.horizon, rung.parameters["mass"]) for rung in fit.horizon.ladder]
    np.testing.assert_allclose(points, expected)
    figure.draw_without_rendering()


def test_predictions_are_drawn_within_what_was_measured(fit):
    figure = fit.plot_predictions(1)
    above, below, *_ = figure.axes
    assert figure.get_suptitle() == "unseen.csv (validation)"
    assert above.get_ylabel() == "x (m)"
    assert below.get_ylabel() == "error of x (m)"
    np.testing.assert_array_equal(above.lines[0].get_ydata(), fit.comparisons[1].measured[:, 0])
    diverged = replace(fit.comparisons[0], free_run=fit.comparisons[0].free_run * 1e9)
    low, high = replace(fit, comparisons=(diverged,)).plot_predictions().axes[0].get_ylim()
    assert high - low < 2 * np.ptp(diverged.measured[:, 0])
    with pytest.raises(InputError, match=r"recording must be < 2, .* got 2"):
        fit.plot_predictions(2)


def test_a_learned_curve_is_drawn_over_the_excited_range(fit):
    (axes,) = fit.plot_map("spring").axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "spring (N)")
    x, values = axes.lines[0].get_data()
    assert (x[0], x[-1]) == (fit.excited[:, 0].min(), fit.excited[:, 0].max())
    np.testing.assert_allclose(values, fit.spring(x))
    wider = fit.plot_map("spring", x=(-9.0, 9.0)).axes[0].lines[1].get_ydata()
    assert np.isnan(wider[0])
    assert np.isfinite(wider).any()


def test_a_map_of_two_arguments_is_drawn_an_output_a_panel(machine_fit):
    figure = machine_fit.plot_map("differential_inductance", i_d=(-100.0, 0.0))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert [axes.get_xlabel() for axes in figure.axes[:4]] == ["i_d (A)"] * 4
    assert "differential_inductance[1, 0] (H)" in labels
    assert figure.axes[0].get_xlim() == (-100.0, 0.0)


def test_what_cannot_be_drawn_is_refused_with_the_mend(fit):
    with pytest.raises(InputError, match=r"the map must be one of \['spring'\], got 'friction'"):
        fit.plot_map("friction")
    with pytest.raises(InputError, match="got 0 and 2"):
        replace(fit, horizon=replace(fit.horizon, ladder=())).plot_ladder()


def test_a_range_is_wanted_for_an_argument_that_is_no_state(fit, monkeypatch):
    monkeypatch.setattr(type(fit.model), "maps", lambda self: {"stiffness": lambda load: load**2})
    with pytest.raises(InputError, match=r"give its range, load=\(low, high\)"):
        fit.plot_map("stiffness")
    curve = fit.plot_map("stiffness", load=(0.0, 2.0)).axes[0].lines[0].get_data()
    np.testing.assert_allclose(curve[1], curve[0] ** 2)


def test_no_plotting_library_is_loaded_with_the_fit():
    code = "import sys, penode; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
