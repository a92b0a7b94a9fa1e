"""The report of a model that is no machine: every section, units beside every error, its maps."""

import dataclasses
import re
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from penode.models.base import Model
from penode.report.fit_report import PARTS, Page, fit_report
from penode.report.learned_maps import map_columns, map_figures, map_values
from penode.report.quantities import number

GAP = "\N{NO-BREAK SPACE}"


class Flat(Model):
    """A model of two states; its maps are given by the test."""

    states: ClassVar = ("x", "v")
    state_units: ClassVar = ("m", "m/s")
    inputs: ClassVar = ("force",)
    map_units: ClassVar = {"plane": "N"}

    def derivative(self, x, u):
        return x

    def learned(self, x):
        return 3.0 * x[1:]


class Fitted:
    """What the drawing of maps asks of a fit."""

    def __init__(self, **maps):
        rng = np.random.default_rng(2)
        self.model = type("Drawn", (Flat,), {"maps": lambda _: maps})()
        self.excited = rng.uniform((-1.0, -40.0), (1.0, 60.0), (2000, 2))
        self.__dict__.update(maps)

    def supported(self, points):
        return np.abs(points[:, 0]) < 0.9

    def learned_deviation(self, points):
        return 0.1 + 0.01 * np.abs(points[:, 1:])


@pytest.fixture(scope="module")
def text(oscillator):
    return fit_report(oscillator.fit)


def test_a_report_of_any_model_has_every_section(text):
    titles = re.findall(r"<h2 [^>]*>([^<]*)</h2>", text)
    assert titles == [
        "Parameters over the horizon",
        "Uncertainty budget",
        "Points against the model",
        "Learned maps",
        "Prediction against measurement",
        "What the model does not explain",
        "What the loss of each horizon consists of",
        "All horizons",
        "Provenance",
    ]
    assert len(titles) == len(PARTS)


def test_the_heading_has_every_parameter(text, oscillator):
    (title,) = re.findall(r"<h1 [^>]*>([^<]*)</h1>", text)
    assert re.fullmatch(rf"Mass = [\d.]+{GAP}kg and .*|mass = .*", title)
    for name, estimate in oscillator.fit.parameters.items():
        assert name in title
        assert f'<data value="{estimate.value:.12g}">' in text


def test_errors_have_the_unit_of_their_state(text, oscillator):
    unseen = oscillator.fit.comparisons[-1]
    x, v = unseen.free_run_errors.values()
    assert f"x{GAP}{number(x)}{GAP}m, v{GAP}{number(v)}{GAP}m/s" in text
    assert "free-run rmse of x in" in text
    shown = re.sub(r"<(script|style).*?</\1>", "", text, flags=re.DOTALL)
    assert not re.search(r"\bnan\b", shown)


def test_a_section_is_one_function_and_one_line(oscillator):
    known = PARTS[-1](oscillator.fit)

    def own(fit):
        return dataclasses.replace(known, title=f"Of {len(fit.parameters)} parameters")

    page = Page(kind="Oscillator", headline=("mass",), parts=(own, lambda _: None))
    document = page.document(oscillator.fit)
    assert [section.title for section in document.sections] == ["Of 2 parameters"]
    assert document.title.startswith("Mass is")


def test_a_page_with_sections_of_its_own_has_every_other_part():
    def own(fit):
        return None

    def added(fit):
        return None

    parts = Page(parts=(*PARTS, added), own={PARTS[1]: (own, own)}).all_parts()
    assert parts == (PARTS[0], own, own, *PARTS[2:], added)


def test_a_curve_holds_the_map_and_its_band(oscillator):
    fit = oscillator.fit
    (figure,) = map_figures(fit, "spring")
    solid = next(trace for trace in figure.plot.data if trace.name == "recorded")
    x, drawn = (np.asarray(one, dtype=float) for one in (solid.x, solid.y))
    inside = np.isfinite(drawn)
    np.testing.assert_allclose(drawn[inside], fit.spring(x[inside]), rtol=1e-5, atol=1e-6)
    band = next(trace for trace in figure.plot.data if trace.name == "95 % band")
    half = len(band.x) // 2
    width = (np.asarray(band.y[half:])[::-1] - np.asarray(band.y[:half])) / 2
    at = np.column_stack([band.x[:half], np.zeros(half)]).astype(float)
    deviation = fit.learned_deviation(at)[:, 0]
    np.testing.assert_allclose(width, 1.96 * deviation, rtol=1e-3, atol=1e-6)
    assert figure.plot.layout.xaxis.title.text == "x in m"


def test_arguments_say_over_which_states_a_map_is_drawn():
    fit = Fitted(
        speed=lambda v: 3.0 * v,
        swapped=lambda v, x: x - v,
        by_order=lambda a, b: a + b,
        foreign=lambda temperature: temperature,
        scaled=lambda v, gain=2.0: gain * v,
    )
    assert map_columns(fit, "speed") == (1,)
    assert map_columns(fit, "swapped") == (1, 0)
    assert map_columns(fit, "by_order") == (0, 1)
    assert map_columns(fit, "foreign") is None
    assert map_columns(fit, "scaled") == (1,)
    assert map_figures(fit, "foreign") == []


def test_a_band_is_drawn_of_outputs_of_learned_alone():
    fit = Fitted(speed=lambda v: 3.0 * v, other=lambda v: 4.0 * v)
    at = np.array([[-20.0], [30.0]])
    known = map_values(fit, "speed", (1,), at)
    np.testing.assert_allclose(known.half_band, 1.96 * (0.1 + 0.01 * np.abs(at.T)))
    assert np.isnan(map_values(fit, "other", (1,), at).half_band).all()


def test_contours_have_the_axes_and_units_of_their_states():
    fit = Fitted(plane=lambda x, v: np.stack([20 * x + v, x * v, 0 * x]))
    first, second = map_figures(fit, "plane")
    assert first.plot.layout.xaxis.title.text == "x in m"
    assert first.plot.layout.yaxis.title.text == "v in m/s"
    assert first.plot.layout.yaxis.scaleanchor is None
    titles = [note.text for figure in (first, second) for note in figure.plot.layout.annotations]
    assert titles == [f"<b>plane[{k}]</b> in N" for k in range(3)]
    filled = next(trace for trace in first.plot.data if trace.hovertemplate)
    x, v = np.meshgrid(filled.x, filled.y)
    np.testing.assert_allclose(filled.z, 20 * x + v, rtol=1e-4, atol=1e-3)


def test_maps_that_cannot_be_drawn_are_named(oscillator):
    class Wide(type(oscillator.fit.model)):
        def maps(self):
            return {"spring": self._force, "drag": lambda temperature: temperature}

    model = object.__new__(Wide)
    for name, value in vars(oscillator.fit.model).items():
        object.__setattr__(model, name, value)
    text = fit_report(dataclasses.replace(oscillator.fit, model=model))
    assert "drag: drawn are maps of one or two states" in text


def test_the_caption_says_of_points_what_is_so(oscillator):
    """Points that were joined to a fit moved its answer; those of one objective are in each bar."""
    fit = oscillator.fit
    words = f"after {fit.stationary.name} has moved and narrowed it"
    assert words in fit_report(fit)
    inside = replace(fit, stationary=replace(fit.stationary, distance=1.0))
    assert words not in fit_report(inside)
