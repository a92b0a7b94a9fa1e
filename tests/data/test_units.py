"""Units: factors against their definitions, spellings, and the refusal of others."""

import numpy as np
import pytest

from penode.data.units import UNITS, find_unit, unit_name
from penode.errors import InputError, did_you_mean


@pytest.mark.parametrize(
    ("unit", "value", "si"),
    [
        ("ms", 3.0, 3e-3),
        ("us", 250.0, 250e-6),
        ("kV", 0.4, 400.0),
        ("mA", 1500.0, 1.5),
        ("deg", 180.0, np.pi),
        ("turn", 0.25, np.pi / 2),
        ("rpm", 60.0, 2 * np.pi),
        ("Hz", 50.0, 100 * np.pi),
        ("deg/s", 360.0, 2 * np.pi),
        ("%", 12.0, 0.12),
    ],
)
def test_factors(unit, value, si):
    np.testing.assert_allclose(UNITS[unit].to_si(np.array([value])), [si], rtol=1e-15)


def test_whole_microseconds_become_the_nearest_number():
    """3 us is 0.000003 s to the last digit, which a product with 1e-6 would miss."""
    expected = [float(f"{k}e-6") for k in range(1000)]
    np.testing.assert_array_equal(UNITS["us"].to_si(np.arange(1000.0)), expected)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (" [1/min] ", "rpm"),
        ("U/min", "rpm"),
        ("(µs)", "us"),
        ("°", "deg"),
        ("RPM", "rpm"),
        ("-", "1"),
        ("MV", None),
        ("Nm", "Nm"),
        ("lx", None),
        ("", None),
    ],
)
def test_spellings(text, name):
    assert unit_name(text) == name


def test_unknown_unit_suggests_the_nearest():
    with pytest.raises(
        InputError, match=r"run.csv: channel n: unknown unit 'rmp' .*did you mean rpm\?"
    ):
        find_unit("run.csv: channel n", "rmp")


def test_nothing_is_suggested_where_nothing_is_near():
    assert did_you_mean("zzzz", ["column", "unit"]) == ""


@pytest.mark.parametrize(
    ("unit", "value", "celsius"),
    [
        ("degC", 20.0, 20.0),
        ("K", 273.15, 0.0),
        ("degF", 212.0, 100.0),
        ("degF", -40.0, -40.0),
    ],
)
def test_temperatures_at_their_fixed_points(unit, value, celsius):
    np.testing.assert_allclose(UNITS[unit].to_si(np.array([value])), [celsius], atol=1e-12)


def test_a_factor_scales_counts_before_the_offset():
    """A sensor of 0.1 K a count: 2981.5 counts are 25 degrees Celsius."""
    np.testing.assert_allclose(UNITS["K"].to_si(np.array([2981.5]), 0.1), [25.0], atol=1e-12)


@pytest.mark.parametrize(
    ("small", "large", "ratio"),
    [("mV", "V", 1e3), ("V", "kV", 1e3), ("A", "kA", 1e3), ("ns", "us", 1e3), ("%", "1", 100.0)],
)
def test_prefixes_of_one_quantity_are_in_proportion(small, large, ratio):
    one = np.array([1.0])
    assert UNITS[small].si == UNITS[large].si
    assert UNITS[large].to_si(one) / UNITS[small].to_si(one) == pytest.approx(ratio)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("°C", "degC"),
        ("℃", "degC"),
        ("Kelvin", "K"),
        ("°F", "degF"),
        ("Sekunden", "s"),
        ("μs", "us"),
        ("Grad", "deg"),
        ("U", "turn"),
        ("1/s", "Hz"),
        ("min^-1", "rpm"),
        ("°/s", "deg/s"),
        ("{ rad*s^-1 }", "rad/s"),
        ("ma", None),
    ],
)
def test_more_spellings(text, name):
    assert unit_name(text) == name


def test_the_nearest_word_is_found_whatever_its_case():
    assert did_you_mean("HORIZN", ["seed", "horizon"]) == " (did you mean horizon?)"
    assert did_you_mean("ab", ["abcdefgh"]) == ""
    # What all columns begin with does not make one of them meant.
    columns = ["Mot_nRot", "Mot_phiEl", "Mot_tStator"]
    assert did_you_mean("Mot_speed", columns) == ""
    for slip in ("Mot_nRotor", "Mot_nRox"):
        assert did_you_mean(slip, columns) == " (did you mean Mot_nRot?)"
    assert did_you_mean("magnet", ["magnet_flux"]) == " (did you mean magnet_flux?)"
