"""The machine report: complete, self-contained, safe with hostile names, true to its record."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from penode import Experiment
from penode.fit.fit import Estimate, HorizonChoice, HorizonSummary
from penode.fit.outcome import Contribution
from penode.pmsm.report.flux_sections import (
    current_grid,
    differential_inductances,
    flux_map_contours,
    flux_map_surfaces,
)
from penode.pmsm.report.flux_slices import flux_slice, slice_currents
from penode.pmsm.report.inductance_table import apparent_inductances, inductance_table
from penode.pmsm.report.machine_report import MACHINE_PAGE, machine_report
from penode.pmsm.report.no_current import no_current
from penode.pmsm.report.torque_sections import torque_and_operating_points
from penode.report import sections
from penode.report.document import Figure
from penode.report.fit_report import PARTS
from penode.validation.comparison import Comparison, by_recording
from penode.validation.residual_tests import Spectrum, residual_correlations

ELECTRICAL_FREQUENCY = 125.0
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
INPUTS = ("u_d", "u_q", "omega_el")


def flux_map(i_d, i_q):
    """Flux linkage (2, ...) in Vs of a saturating machine."""
    return np.stack(
        [
            0.05 + 150e-6 * i_d + 0.012 * np.tanh((i_d + 150) / 180) - 4e-8 * i_q**2,
            140e-6 * i_q + 0.036 * np.tanh(i_q / 130) - 8e-8 * i_d * i_q,
        ]
    )


def differential_inductance(i_d, i_q):
    """L (2, 2, ...) in H, the Jacobian of `flux_map`."""
    i_d, i_q = np.broadcast_arrays(i_d, i_q)
    l_dd = 150e-6 + 0.012 / 180 / np.cosh((i_d + 150) / 180) ** 2
    l_qq = 140e-6 + 0.036 / 130 / np.cosh(i_q / 130) ** 2 - 8e-8 * i_d
    return np.stack([np.stack([l_dd, -8e-8 * i_q]), np.stack([-8e-8 * i_q, l_qq])])


def supported(points):
    """Whether points (n, 2) lie in the half disc that the trajectory fills."""
    return (np.hypot(*points.T) < 305) & (points[:, 0] < 5)


def trajectory(samples, time_step):
    time = np.arange(samples) * time_step
    i_q = 300 * np.sin(15 * time)
    i_d = -np.sqrt(np.maximum(300**2 - i_q**2, 0)) * np.abs(np.sin(14 * time))
    return time, np.stack([i_d, i_q], axis=1)


def comparison(name, role, samples=4000, time_step=1e-4, diverges_at=None):
    rng = np.random.default_rng(len(name))
    time, smooth = trajectory(samples, time_step)
    turn = 2 * np.pi * ELECTRICAL_FREQUENCY * time
    ripple = np.stack([4 * np.cos(6 * turn), 3 * np.sin(6 * turn) + np.cos(12 * turn)], axis=1)
    measured = smooth + ripple + rng.normal(0, 0.4, smooth.shape)
    free_run = smooth + np.stack([2 * np.sin(9 * time), 1.5 * np.cos(7 * time)], axis=1)
    if diverges_at is not None:
        free_run[diverges_at - 80 : diverges_at] += np.exp(np.linspace(0, 60, 80))[:, None]
        free_run[diverges_at:] = np.nan
    one_step = measured + 0.15 * ripple + rng.normal(0, 0.2, smooth.shape)
    return Comparison(
        name, role, time_step, ("i_d", "i_q"), ("A", "A"), measured, one_step, free_run
    )


def spectrum_of(one):
    residual = (one.one_step - one.measured) * np.hanning(len(one.measured))[:, None]
    amplitude = 4 * np.abs(np.fft.rfft(residual, axis=0)) / len(residual)
    return Spectrum(one.name, np.fft.rfftfreq(len(residual), one.time_step), amplitude)


def correlations_of(one):
    drives = {name: np.sin(k + np.arange(len(one.measured)) / 40) for k, name in enumerate(INPUTS)}
    recording = Experiment(one.name, one.time_step, drives)
    return residual_correlations(one, recording, INPUTS)


def ladder(values, std):
    horizons = [1, 2, 3, 5, 8, 12, 17, 25, 38, 57, 85, 128]
    return tuple(
        HorizonSummary(
            h,
            {"R": r, "dead_time_voltage": 2 + 3 * (0.01 - r) * 10},
            {"R": s, "dead_time_voltage": 250 * s},
            0.4 + 0.02 * k,
            None if k == 0 else 4.6 - 0.14 * k,
            12 - k // 2,
            "Every reported number moved by less than a tenth of its standard error.",
        )
        for k, (h, r, s) in enumerate(zip(horizons, values, std, strict=True))
    )


def answered():
    k = np.arange(12)
    values = 10.018e-3 - 85e-3 * np.exp(-k / 0.9) + 5e-5 * np.sin(3 * (k - 9))
    return HorizonChoice(
        57,
        "plateau",
        "Six neighbouring horizons agree; the one with the smallest variance is reported.",
        ladder(values, 0.9e-3 * np.exp(-k / 3) + 6e-5),
        (17, 25, 38, 57, 85, 128),
    )


def refused():
    k = np.arange(12)
    return HorizonChoice(
        57,
        "no plateau",
        "No three neighbouring horizons agree. Record a second speed, or reverse the speed.",
        ladder(4e-3 + 3.2e-3 * k, np.full(12, 0.4e-3)),
    )


def learned_deviation(points, direction=None):
    return (1e-4 if direction is None else 1e-6) * (1 + np.abs(points) / 300)


def machine_fit(choice=None, comparisons=None, warnings=(), **provenance):
    comparisons = comparisons or (
        comparison("slow_1500rpm.csv", "train"),
        comparison("unseen_900rpm.csv", "validation"),
    )
    return SimpleNamespace(
        model=SimpleNamespace(
            states=("i_d", "i_q"), state_units=("A", "A"), inputs=INPUTS, unmeasured=()
        ),
        parameters={
            "R": Estimate(
                10.018e-3, 0.086e-3, (9.849e-3, 10.187e-3), "ohm", 0.76, "stator resistance"
            ),
            "dead_time_voltage": Estimate(1.984, 0.031, (1.923, 2.045), "V", 0.91),
        },
        covariance=np.array([[7.4e-9, 8e-7], [8e-7, 9.6e-4]]),
        correlation=np.array([[1.0, 0.3], [0.3, 1.0]]),
        horizon=choice or answered(),
        excited=trajectory(4000, 2e-4)[1],
        comparisons=comparisons,
        recordings=by_recording(comparisons),
        spectrum=spectrum_of(comparisons[0]),
        transitions=np.array([[[0.99, 0.09], [-0.07, 0.99]]]),
        starts=np.ones(2),
        initial_states={},
        stationary=None,
        warnings=tuple(warnings),
        provenance={
            "electrical_frequency_hz": ELECTRICAL_FREQUENCY,
            "versions": {"penode": "0.1.0", "jax": "0.10.2"},
            "recordings": [{"path": "slow_1500rpm.csv", "sha256": "9f" * 32}],
            "seeds": [1, 2, 3],
            "wall_time_s": 41.2,
            **provenance,
        },
        correlations=correlations_of(comparisons[0]),
        learned_deviation=learned_deviation,
        flux_map=flux_map,
        differential_inductance=differential_inductance,
        supported=supported,
    )


class Page(HTMLParser):
    """Collects what the tests ask for, and checks that elements close in order."""

    VOID = frozenset({"wbr", "meta", "br", "link", "img", "input", "hr"})

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.attributes = [], [], []
        self.headings, self.data, self.styles, self.values = [], {}, [], []
        self._script = None
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append(tag)
        self.attributes.append((tag, attributes))
        if tag not in self.VOID:
            self.open.append(tag)
        if tag in {"h1", "h2", "h3"}:
            self.headings.append((tag, ""))
        if tag == "data":
            self.values.append([float(attributes["value"]), ""])
        self._script = attributes.get("id") if tag == "script" else self._script

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        if tag == "script":
            self._script = None

    def handle_data(self, data):
        if self.open and self.open[-1] in {"h1", "h2", "h3"}:
            tag, text = self.headings[-1]
            self.headings[-1] = (tag, text + data)
        if self.open and self.open[-1] == "style":
            self.styles.append(data)
        if self.open and self.open[-1] == "data":
            self.values[-1][1] += data
        if self._script:
            self.data[self._script] = json.loads(data)

    def titles(self, tag):
        return [text for name, text in self.headings if name == tag]


@pytest.fixture(scope="module")
def text():
    return machine_report(machine_fit())


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_answer_is_the_heading_and_the_first_number(page):
    assert page.titles("h1") == ["The stator resistance is 10.018\N{NO-BREAK SPACE}mΩ"]
    assert page.values[0] == [10.018e-3, "10.018\N{NO-BREAK SPACE}mΩ"]


def test_every_question_has_its_section(page):
    assert page.titles("h2") == [
        "Parameters over the horizon",
        "Flux-linkage map",
        "Inductances",
        "Torque and operating points",
        "Prediction against measurement",
        "What the model does not explain",
        "What the loss of each horizon consists of",
        "All horizons",
        "Provenance",
    ]


def test_parts_of_any_report_that_are_not_replaced_are_in_the_machines():
    replaced = {sections.learned_maps, sections.residual_section, sections.loss_weighting}
    assert [p for p in MACHINE_PAGE.all_parts() if p in PARTS] == [
        p for p in PARTS if p not in replaced
    ]


def test_every_figure_has_its_data_title_and_caption(page):
    plots = [a for tag, a in page.attributes if tag == "div" and "data-plot" in a]
    assert len(plots) == page.tags.count("figure") == page.tags.count("figcaption") == 15
    assert all(plot["data-plot"] in page.data for plot in plots)
    identifiers = {a["id"] for _, a in page.attributes if "id" in a}
    for plot in plots:
        assert {plot["aria-labelledby"], plot["aria-describedby"]} <= identifiers


def test_identifiers_are_unique_and_links_lead_somewhere(page):
    identifiers = [a["id"] for _, a in page.attributes if "id" in a]
    assert len(identifiers) == len(set(identifiers))
    targets = {a["href"] for tag, a in page.attributes if tag == "a"}
    assert targets <= {f"#{name}" for name in identifiers}


def test_nothing_is_fetched(page):
    for _, attributes in page.attributes:
        assert not {"src", "srcset", "data", "poster", "background"} & set(attributes)
        assert attributes.get("href", "#").startswith("#")
    style = "".join(page.styles)
    assert "@import" not in style
    assert "url(" not in style
    policies = [a["content"] for tag, a in page.attributes if "http-equiv" in a]
    assert policies
    assert policies[0].startswith("default-src 'none'")


def test_page_stays_small(text):
    assert len(text.encode()) < 12e6


def test_shown_numbers_are_those_of_the_record(page):
    """Cells carry twelve digits, so that a fit that was saved gives the same page."""
    fit = machine_fit()
    values = {value for value, _ in page.values}

    def shown(*numbers):
        return {float(f"{number:.12g}") for number in numbers}

    for estimate in fit.parameters.values():
        assert shown(estimate.value, estimate.std, estimate.identifiability) <= values
    for rung in fit.horizon.ladder:
        assert shown(rung.rmse, rung.iterations, *rung.parameters.values()) <= values
    for one in fit.comparisons:
        assert shown(one.one_step_rmse, one.free_run_rmse) <= values


def test_hostile_names_stay_text():
    hostile = "</script><script>alert(1)</script>"
    fit = machine_fit(
        comparisons=(comparison(hostile, "validation"),), warnings=[hostile], note=hostile
    )
    text = machine_report(fit)
    page = Page(text)
    assert hostile not in text
    assert page.tags.count("script") == Page(machine_report(machine_fit())).tags.count("script") - 1


def test_refusal_says_so_in_words_and_names_no_resistance():
    text = machine_report(machine_fit(refused(), warnings=["One speed only."]))
    page = Page(text)
    assert page.titles("h1") == ["These recordings cannot determine the stator resistance"]
    implausible = replace(refused(), verdict="implausible")
    (title,) = Page(machine_report(machine_fit(implausible))).titles("h1")
    assert (
        title == "No answer on the stator resistance: the model does not explain these recordings"
    )
    classes = [a.get("class") for _, a in page.attributes]
    assert "notice refusal" in classes
    assert "notice caution" in classes
    assert "doubtful" in classes
    assert "The data cannot answer (verdict: no plateau)" in text
    assert "4.0 to 39.2\N{NO-BREAK SPACE}mΩ" in text


def test_divergence_is_stated():
    fit = machine_fit(comparisons=(comparison("a.csv", "validation", diverges_at=2000),))
    text = machine_report(fit)
    assert (
        "a.csv (not used for training): the free run diverges after 200\N{NO-BREAK SPACE}ms" in text
    )
    assert "diverged" in text


def test_largest_line_is_named(text):
    assert ", at 750\N{NO-BREAK SPACE}Hz, 6×" in text


def test_the_lines_are_named_with_their_causes(text):
    assert "The largest part of the loss is the line at" in text
    for words in (
        "−6×",
        "+12×",
        "−5× in the phases: slots",
        "125\N{NO-BREAK SPACE}Hz, as the rotor",
    ):
        assert words in text


def test_the_residual_is_drawn_over_speed_and_one_turn_of_the_angle():
    fit = machine_fit()
    assert "omega_el" in [one.channel for one in fit.correlations.over]
    text = machine_report(fit)
    assert "along omega_el" in text
    assert "along u_d" not in text
    (one, *_) = fit.correlations.over
    turns = [replace(one, channel="theta_el", value=np.linspace(0, end, 40)) for end in (6.2, 99.0)]
    for angle, shown in zip(turns, (True, False), strict=True):
        fit.correlations = replace(fit.correlations, over=(angle,))
        page = machine_report(fit)
        assert ("along theta_el" in page) is shown
        assert ("theta_el in rad" in page) is shown


def test_without_a_speed_lines_go_by_their_frequency():
    fit = machine_fit(electrical_frequency_hz=None)
    assert "is the line at 750\N{NO-BREAK SPACE}Hz" in machine_report(fit)


def test_a_fit_without_one_step_matrices_has_no_such_section():
    fit = machine_fit()
    fit.transitions = np.empty((0, 0, 0))
    assert "What the loss of each horizon consists of" not in machine_report(fit)


def test_report_without_comparisons_or_frequency():
    fit = machine_fit(electrical_frequency_hz=None)
    fit.comparisons = ()
    assert Page(machine_report(fit)).titles("h2")


def test_contours_show_the_map_in_millivolt_seconds():
    fit = machine_fit()
    grid = current_grid(fit, 121)
    first = flux_map_contours(fit).data[0]
    expected = 1e3 * flux_map(*grid.mesh)[0]
    np.testing.assert_allclose(np.asarray(first.z), expected, rtol=1e-6)


def test_contour_panels_have_one_aspect():
    for figure in (flux_map_contours(machine_fit()), differential_inductances(machine_fit())):
        axes = [axis for axis in figure.layout if re.fullmatch(r"yaxis\d*", axis)]
        assert len(axes) >= 2
        assert all(figure.layout[axis].scaleanchor for axis in axes)


def test_inductances_are_in_microhenry_and_in_order():
    fit = machine_fit()
    figure = differential_inductances(fit)
    filled = [trace for trace in figure.data if trace.type == "contour" and trace.hovertemplate]
    grid = current_grid(fit, 121)
    expected = 1e6 * differential_inductance(*grid.mesh)
    for trace, entry in zip(filled, ((0, 0), (0, 1), (1, 1)), strict=True):
        np.testing.assert_allclose(np.asarray(trace.z), expected[entry], rtol=1e-5, atol=1e-4)


def test_apparent_inductances_are_mean_slopes_from_zero():
    current = np.array([[0.0, -120.0, -60.0], [0.0, 80.0, 0.0]])
    l_d, l_q = apparent_inductances(machine_fit(), current)
    share = (np.arange(4000) + 0.5) / 4000
    for k, (i_d, i_q) in enumerate(current.T):
        mean_d = differential_inductance(share * i_d, i_q)[0, 0].mean()
        mean_q = differential_inductance(i_d, share * i_q)[1, 1].mean()
        assert (l_d[k], l_q[k]) == pytest.approx((mean_d, mean_q), rel=1e-6)


def test_slices_are_the_map_with_its_band_where_recordings_have_been():
    fit = machine_fit()
    for axis in range(2):
        figure = flux_slice(fit, axis)
        bands = [trace for trace in figure.data if trace.fill]
        lines = [trace for trace in figure.data if trace.showlegend]
        assert len(bands) == len(lines) >= 2
        for line, band, points in zip(lines, bands, slice_currents(fit, axis), strict=True):
            expected = 1e3 * flux_map(*points.T)[axis]
            inside = supported(points)
            np.testing.assert_allclose(line.y[inside], expected[inside])
            assert np.isnan(line.y[~inside]).all()
            (whole,) = outlines(band)
            assert len(whole) == 2 * inside.sum()
            deviation = 1e-4 * (1 + np.abs(points[inside][0, axis]) / 300)
            width = whole[-1] - whole[0]
            assert width == pytest.approx(2 * 1.96 * 1e3 * deviation, rel=1e-3)


def outlines(band):
    """Return the values of each outline of a band."""
    ends = np.flatnonzero(np.isnan(band.y))
    assert np.isnan(np.asarray(band.x)[ends]).all()
    return [part[~np.isnan(part)] for part in np.split(np.asarray(band.y), ends)[:-1]]


def test_a_slices_band_does_not_go_through_a_hole():
    fit = machine_fit()
    fit.supported = lambda points: supported(points) & (np.abs(points[:, 0] + 60.0) > 30.0)
    bands = [trace for trace in flux_slice(fit, 0).data if trace.fill]
    for band, points in zip(bands, slice_currents(fit, 0), strict=True):
        left = np.sum(fit.supported(points) & (points[:, 0] < -60.0))
        first, _ = outlines(band)
        assert len(first) == 2 * left


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({}, ("Nm per pole pair", "set pole_pairs", "No voltage of the DC link is known")),
        ({"pole_pairs": 5, "link_voltage_v": 350.0}, ("Base speed", "at 202", "The torque of")),
    ],
)
def test_torque_says_what_it_knows(facts, words):
    text = machine_report(machine_fit(**facts))
    for one in words:
        assert one in text


def test_torque_lines_are_dotted_where_no_recording_has_been():
    fit = machine_fit(pole_pairs=5, link_voltage_v=350.0)
    (figure, *_) = [b for b in torque_and_operating_points(fit).blocks if isinstance(b, Figure)]
    styles = {}
    for trace in figure.plot.data:
        if trace.type == "scatter" and trace.mode == "lines":
            styles.setdefault(trace.name, []).append(trace.line.dash)
            if trace.line.dash == "solid":
                drawn = np.isfinite(np.asarray(trace.y, dtype=float))
                assert supported(np.stack([trace.x, trace.y], axis=1)[drawn]).all()
    assert {"MTPA", "current limit", "voltage limit, rpm of the shaft"} <= set(styles)
    assert all(set(dashes) == {"dot", "solid"} for dashes in styles.values())


def test_torque_is_not_shown_of_a_standstill():
    assert torque_and_operating_points(machine_fit(standstill=True)) is None


def test_surface_is_blank_where_nothing_was_recorded():
    for trace in flux_map_surfaces(machine_fit()).data:
        i_d, i_q, height = (np.asarray(trace[name], dtype=float) for name in "xyz")
        drawn = np.isfinite(height)
        assert 0.2 < drawn.mean() < 0.9
        radius = np.hypot(i_d, i_q)[drawn]
        assert radius.max() < 305.1
        assert radius.max() > 304.5
        assert i_d[drawn].max() < 5.1


@pytest.mark.skipif(CHROMIUM is None, reason="No Chromium on this machine to draw the page with.")
@pytest.mark.slow
@pytest.mark.parametrize("width", [1300, 420])
def test_a_browser_draws_every_figure_without_complaint(text, tmp_path, width):
    path = Path(tmp_path, "report.html")
    path.write_text(text, encoding="utf-8")
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
        "--no-first-run", "--disable-background-networking", "--disable-component-update",
        "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader", "--enable-logging=stderr",
        f"--user-data-dir={tmp_path}/profile", f"--window-size={width},2000",
        "--virtual-time-budget=20000", "--dump-dom", path.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    complaints = [
        line
        for line in done.stderr.splitlines()
        if "CONSOLE" in line and not re.search(r"WebGL|GPU stall|willReadFrequently", line)
    ]
    assert complaints == []
    drawn = re.findall(r'id="figure-\d+-title">.*?</figure>', done.stdout, flags=re.DOTALL)
    assert len(drawn) == 15
    for figure in drawn:
        assert "main-svg" in figure or "unavailable" in figure


def test_the_magnet_and_the_inductances_stand_in_the_answer():
    magnet, *inductances = no_current(machine_fit())
    psi = flux_map(0.0, 0.0)[0]
    assert magnet.value == psi
    low, high = psi - 1.96e-4, psi + 1.96e-4
    assert f"{1e3 * low:.2f} to {1e3 * high:.2f}" in magnet.detail
    for one, slope in zip(inductances, np.diag(differential_inductance(0.0, 0.0)), strict=True):
        assert one.value == slope
        assert f"{1e6 * slope - 1.96:.1f} to {1e6 * slope + 1.96:.1f}" in one.detail
    assert "psi_PM" in machine_report(machine_fit())


def test_the_temperature_that_resistance_belongs_to_stands_in_the_answer():
    assert "Winding that R belongs to" not in machine_report(machine_fit())
    warm = machine_fit(recorded_temperatures={"winding_temperature": (41.0, 40.0, 42.0)})
    assert "41.0\N{NO-BREAK SPACE}°C" in machine_report(warm)


def test_nothing_is_said_at_no_current_where_it_is_not_known():
    beyond = machine_fit()
    beyond.supported = lambda points: points[:, 0] < -1
    for fit in (beyond, machine_fit(refused()), machine_fit(standstill=True)):
        assert no_current(fit) == ()


def test_an_interval_that_the_sensors_make_says_so():
    fit = machine_fit()
    data = Contribution("statistics of the residuals", 2e-6)
    gain = Contribution("gain of the voltages", 1e-4, "1 %", "Calibrate.", "assumed")
    for origin, words in (("assumed", "assumed of the sensors; give"), ("declared", "declared of")):
        budget = (replace(gain, origin=origin), data)
        fit.parameters["R"] = Estimate.of(0.01, 1e-4, "ohm", budget=budget)
        page = machine_report(fit)
        assert f"mostly by the accuracy {words}" in page
        assert "the data alone: ±\N{NO-BREAK SPACE}0.0039\N{NO-BREAK SPACE}mΩ" in page
    fit.parameters["R"] = Estimate.of(0.01, 1e-4, "ohm", budget=(replace(data, std=1e-4),))
    assert "mostly by the accuracy" not in machine_report(fit)


def test_lines_at_orders_that_the_map_follows_are_not_said_to_be_beyond_it():
    fit = machine_fit()
    assert "a map of the currents alone cannot follow" in machine_report(fit)
    fit.model.flux = SimpleNamespace(angle_orders=(6, 12))
    page = machine_report(fit)
    assert "of which the map follows the orders 6 and 12" in page
    assert "cannot follow" not in page


def test_differential_inductances_have_intervals_where_the_data_answer():
    fit = machine_fit()
    table = inductance_table(fit)
    column = next(k for k, head in enumerate(table.columns) if head.startswith("L_qq"))
    cell = table.rows[1].cells[column]
    value, half = map(float, cell.text.split(" ± "))
    at = [[table.rows[1].cells[k].value for k in (1, 2)]]
    deviation = fit.learned_deviation(np.array(at), np.array([0.0, 1.0]))[0, 1]
    assert half == pytest.approx(1e6 * 1.96 * deviation, abs=0.5)
    assert value == pytest.approx(1e6 * cell.value, abs=0.5)
    fit.horizon = SimpleNamespace(answered=False)
    assert "±" not in inductance_table(fit).rows[1].cells[column].text


def test_the_horizon_shown_stands_beside_the_plateau_it_is_of():
    assert "plateau from H = 17 to 128" in machine_report(machine_fit())
    suffices = replace(answered(), verdict="H = 1 suffices")
    assert "suffices from H" not in machine_report(machine_fit(suffices))


def test_a_characteristic_current_far_beyond_the_recordings_is_no_number():
    fit = machine_fit()
    fit.excited = 0.2 * fit.excited
    most = 1.5 * np.hypot(*fit.excited.T).max()
    assert f"more than {most:#.3g}\N{NO-BREAK SPACE}A" in machine_report(fit)


def test_inductances_are_at_positive_i_q_where_both_signs_were_recorded():
    fit = machine_fit()
    fit.excited = np.concatenate([fit.excited, [[-10.0, -310.0]]])
    table = inductance_table(fit)
    column = next(k for k, head in enumerate(table.columns) if head.startswith("i_q"))
    assert min(row.cells[column].value for row in table.rows) == 0
