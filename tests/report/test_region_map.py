"""Maps over two quantities: to scale, drawn where they are backed, their levels labelled."""

import numpy as np
import pytest

from penode.report import panels
from penode.report.learned_maps import band_figures
from penode.report.region_map import RegionGrid, label_places, nice_levels, region_maps


def grid(units=("A", "A"), width=200.0, samples=4000):
    """Return a grid twice as wide as high, supported on an ellipse."""
    x, y = np.linspace(-width / 2, width / 2, 81), np.linspace(-50.0, 50.0, 61)
    inside = np.hypot(*np.meshgrid(x / (0.45 * width), y / 45.0)) < 1
    excited = np.random.default_rng(1).uniform(-40, 40, (samples, 2))
    return RegionGrid(x, y, inside, excited, ("i<sub>d</sub>", "i_q"), units)


def plane(at):
    x, y = at.mesh
    return 0.3 * x + 0.1 * y


def drawn(at, *maps):
    return region_maps(at, ["psi in mVs"] * len(maps), np.stack(maps), "mVs")


def traces(figure, panel=0):
    """Return shading, surroundings, dots, lines and labels of a panel."""
    return figure.data[5 * panel : 5 * panel + 5]


@pytest.mark.parametrize(("count", "width"), [(1, 100.0), (1, 200.0), (2, 100.0), (2, 130.0)])
def test_one_unit_is_drawn_to_one_scale(count, width):
    """The page's plotting area is 866 pixels wide."""
    at = grid(width=width)
    layout = drawn(at, *[plane(at)] * count).layout
    height = layout.height - panels.MARGIN["t"] - panels.MARGIN["b"]
    wide = 866.0 * np.ptp(layout.xaxis.domain)
    tall = height * np.ptp(layout.yaxis.domain)
    assert wide / tall == pytest.approx(width / 100.0, rel=0.01)
    assert layout.yaxis.scaleanchor == "x"


@pytest.mark.parametrize("count", [2, 3])
def test_a_row_of_maps_is_as_wide_as_the_page(count):
    at = grid()
    layout = drawn(at, *[plane(at)] * count).layout
    domains = [layout[panels.axis_key("x", panel)].domain for panel in range(count)]
    assert (domains[0][0], domains[-1][1]) == (0.0, 1.0)
    np.testing.assert_allclose(
        np.ptp(domains, axis=1), (1 + 92 / 866) / count - 92 / 866, rtol=1e-4
    )


def test_two_units_have_scales_of_their_own():
    at = grid(units=("A", "V"), width=2e6)
    layout = drawn(at, plane(at)).layout
    assert layout.yaxis.scaleanchor is None
    assert (layout.xaxis.title.text, layout.yaxis.title.text) == ("i<sub>d</sub> in A", "i_q in V")
    assert tuple(layout.xaxis.range) == (-1e6, 1e6)


def test_lines_and_labels_stand_where_recordings_back_them():
    at = grid()
    one = plane(at)
    _, _, _, lines, labels = traces(drawn(at, one))
    shown = np.isfinite(np.asarray(lines.z, dtype=float))
    np.testing.assert_array_equal(shown, at.supported)
    assert len(labels.text) >= 3
    step = lines.contours.size
    for x, y, text in zip(labels.x, labels.y, labels.text, strict=True):
        level = float(text[3:-4].replace("−", "-"))
        assert 0.3 * x + 0.1 * y == pytest.approx(level, abs=0.2 * step)
        assert np.hypot(x / 90.0, y / 45.0) < 1
    inside = one[at.supported]
    assert lines.contours.start <= inside.min()
    assert lines.contours.end >= inside.max()


def test_the_veil_covers_what_is_not_supported():
    at = grid()
    smooth = np.asarray(traces(drawn(at, plane(at)))[1].z)
    x, y = at.mesh
    radius = np.hypot(x / 90.0, y / 45.0)
    assert (smooth[radius < 0.9] > 0.5).all()
    assert (smooth[radius > 1.1] < 0.5).all()


def test_values_outside_the_region_choose_no_levels():
    at = grid()
    known = plane(at)
    wild = np.where(at.supported, known, 1e6)
    found = [traces(drawn(at, one))[3].contours for one in (known, wild)]
    assert found[0].to_plotly_json() == found[1].to_plotly_json()


def test_many_panels_have_fewer_lines_and_many_samples_fewer_dots():
    at = grid(samples=100_000)
    few, many = (drawn(at, *[plane(at)] * count) for count in (2, 3))
    spacing = [traces(figure)[3].contours.size for figure in (few, many)]
    assert spacing[1] >= 2 * spacing[0]
    assert 1000 <= len(traces(few)[2].x) <= 3000


@pytest.mark.parametrize(
    "values", [[3.0, 97.0], [-0.4, 0.4], [2.0, 2.0], [0.0, 0.0], [-1e-9, 5e-9], [449.9, 450.1]]
)
def test_levels_cover_the_values_at_round_numbers(values):
    levels = nice_levels(np.array(values), 10)
    step = levels[1] - levels[0]
    assert levels[0] <= min(values) + 1e-9 * step
    assert levels[-1] >= max(values) - 1e-9 * step
    assert 2 <= len(levels) <= 16
    mantissa = step / 10 ** np.floor(np.log10(step) + 1e-9)
    assert np.isclose(mantissa, [1, 2, 5]).any()


def test_labels_stand_inside_the_region_on_their_line():
    y, x = np.mgrid[-1:1:81j, -1:1:81j]
    supported = np.hypot(x, y) < 0.9
    levels = np.array([-0.5, 0.0, 0.5])
    places = label_places(x, supported, levels)
    assert places[:, 2].tolist() == [0, 1, 2]
    for row, column, number in places:
        assert np.hypot(x[row, column], y[row, column]) < 0.75
        assert abs(x[row, column] - levels[number]) < 0.05


def test_both_branches_of_a_line_are_labelled_and_apart():
    _, x = np.mgrid[-1:1:81j, -1:1:81j]
    places = label_places(x**2, np.ones(x.shape, dtype=bool), np.array([0.25]))
    assert sorted(np.round(x[places[:, 0], places[:, 1]], 1)) == [-0.5, 0.5]


def test_lines_at_the_rim_get_no_label():
    _, x = np.mgrid[-1:1:81j, -1:1:81j]
    assert label_places(x, np.ones(x.shape, dtype=bool), np.array([0.99])).shape == (0, 3)


def test_a_band_is_told_by_the_component_that_is_known_less():
    at = grid()
    half = np.stack([np.full(at.supported.shape, 1.0), np.full(at.supported.shape, 3.0)])
    half[:, ~at.supported] = 50.0
    figure, *_ = band_figures("The map", at, half, ["a", "b"], "Vs", "currents")
    assert figure.title.replace("\N{NO-BREAK SPACE}", " ") == (
        "The map is known to ±3.0 Vs over half of the area of the recorded currents, to ±3.0 Vs "
        "over 95 % of it"
    )
