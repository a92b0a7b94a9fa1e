"""Numbers as text: the prefix, the digits and the sign."""

import math

import pytest

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
