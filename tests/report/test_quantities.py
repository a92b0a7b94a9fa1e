"""Numbers as text: the prefix, the digits and the sign."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from penode.report.quantities import decimals_for, fixed, number, scale_for, symbol, with_unit

GAP = "\N{NO-BREAK SPACE}"


@pytest.mark.parametrize(
    ("values", "unit", "factor", "shown"),
    [
        ([0.01], "ohm", 1e3, "mΩ"),
        ([9.999e-4], "ohm", 1e6, "µΩ"),
        ([1.0], "V", 1.0, "V"),
        ([999.9], "V", 1.0, "V"),
        ([1000.0], "Hz", 1e-3, "kHz"),
        ([-0.15, 0.02], "Vs", 1e3, "mVs"),
        ([4.5e-4], "H", 1e6, "µH"),
        ([1e-30], "H", 1e12, "pH"),
        ([0.0], "H", 1.0, "H"),
        ([math.nan, math.inf], "H", 1.0, "H"),
        ([0.001], "rad/s", 1.0, "rad/s"),
        ([0.001], "", 1.0, ""),
        ([0.3], "kg", 1.0, "kg"),
    ],
)
def test_prefix_makes_the_largest_value_legible(values, unit, factor, shown):
    scale = scale_for(values, unit)
    assert scale.unit == shown
    assert scale.factor == pytest.approx(factor)


@pytest.mark.parametrize(
    ("std", "value", "decimals"),
    [
        (0.086, 10.018, 3),
        (0.86, 10, 2),
        (8.6, 10, 1),
        (86, 100, 0),
        (0.0, 10.018, 2),
        (math.nan, 0, 0),
    ],
)
def test_uncertainty_gets_two_digits(std, value, decimals):
    assert decimals_for(std, value) == decimals


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (2.958, "2.96"),
        (-74.98, "−75.0"),
        (1234.0, "1234"),
        (0.0, "0.00"),
        (-0.0001, "−0.000100"),
        (1.5e-7, "1.50e−07"),
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "∞"),
        (-math.inf, "−∞"),
    ],
)
def test_numbers_keep_three_digits(value, text):
    assert number(value) == text


def test_zero_has_no_sign():
    assert fixed(-0.0004, 2) == "0.00"


def test_value_and_unit_stay_on_one_line():
    assert with_unit(0.0029, "V") == f"2.90{GAP}mV"
    assert with_unit(0.5, "") == "0.500"


def test_index_follows_one_underscore():
    assert symbol("i_d") == "i<sub>d</sub>"
    assert symbol("dead_time_voltage") == "dead_time_voltage"
    assert symbol("<b>") == "&lt;b&gt;"


PREFIXES = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


@given(st.floats(1e-11, 9e11))
def test_a_prefix_leaves_one_to_three_digits_before_the_point(size):
    scale = scale_for([size / 3, -size], "V")
    assert scale.factor * PREFIXES[scale.unit.removesuffix("V")] == pytest.approx(1.0)
    assert 1 - 1e-9 <= size * scale.factor < 1000


def test_rounding_below_a_power_of_ten_takes_no_smaller_prefix():
    assert scale_for(math.nextafter(1.0, 0.0), "V").unit == "V"


@given(st.floats(1e-9, 1e9), st.integers(1, 6), st.sampled_from([1, -1]))
def test_a_number_as_text_is_right_to_the_digits_asked_for(size, digits, sign):
    text = number(sign * size, digits)
    assert "-" not in text
    magnitude = math.floor(math.log10(size))
    half = 0.5 * 10.0 ** (magnitude + 1 - digits)
    assert abs(float(text.replace("−", "-")) - sign * size) <= half * (1 + 1e-9)
    shown = text.strip("−").split("e")[0].replace(".", "").lstrip("0")
    whole = len(text.strip("−").split(".")[0])
    assert len(shown) == digits or (whole > digits and "." not in text)


def test_rounding_up_adds_no_digit():
    assert [number(size) for size in (9.996, 99.96, 0.09996)] == ["10.0", "100", "0.100"]


@given(st.floats(1e-8, 99.0))
def test_the_last_two_digits_shown_are_those_of_the_uncertainty(std):
    assert 10 <= std * 10 ** decimals_for(std, 1.0) * (1 + 1e-9) < 100 * (1 + 1e-8)


@pytest.mark.parametrize(("std", "value", "decimals"), [(1e-15, 1.0, 9), (math.inf, 1e-3, 6)])
def test_decimals_have_an_end_and_an_unknown_deviation_leaves_four_digits(std, value, decimals):
    assert decimals_for(std, value) == decimals


@pytest.mark.parametrize(
    ("name", "markup"),
    [
        ("psi_mean", "psi<sub>mean</sub>"),
        ("flux_d", "flux_d"),
        ("u_dcbus", "u_dcbus"),
        ("i_d_ref", "i_d_ref"),
    ],
)
def test_only_a_short_name_has_an_index(name, markup):
    assert symbol(name) == markup


@pytest.mark.parametrize(("value", "text"), [(None, "–"), (math.nan, "–"), (-math.inf, "−∞")])
def test_what_is_no_number_has_no_unit(value, text):
    assert with_unit(value, "V") == text
