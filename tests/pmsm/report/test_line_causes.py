"""A drive's lines by name: orders in both frames, causes, and the sense of rotation."""

import numpy as np
import pytest

from penode.pmsm.report.line_causes import named_lines, signed_frequency
from penode.validation.residual_lines import Line, find_lines, power_spectrum

BASE, STEP, SAMPLES = 125.0, 1e-4, 20_000


def line(frequency, half_width=1.0):
    low, high = frequency - half_width, frequency + half_width
    return Line(0, frequency, low, high, 0.1, 0.5, frequency / BASE)


def name(frequency, base=BASE, pole_pairs=None, half_width=1.0):
    return named_lines([line(frequency, half_width)], base, pole_pairs)[0]


@pytest.mark.parametrize(
    ("frequency", "order", "words"),
    [
        (0.4, 0, "resistance"),
        (-125.0, -1, "offset of a current sensor"),
        (-250.3, -2, "unequal gains"),
        (-750.0, -6, "slots"),
        (1500.0, 12, "dead time"),
        (375.0, 3, "no usual cause"),
        (412.0, 412 / 125, "no multiple"),
        (736.0, 736 / 125, "side band of +6×"),
        (-1514.0, -1514 / 125, "side band of −12×"),
    ],
)
def test_every_order_has_its_cause(frequency, order, words):
    found = name(frequency)
    assert found.order == pytest.approx(order)
    assert found.stationary_order == pytest.approx(order + 1)
    assert words in found.cause


def test_backward_rotation_turns_the_orders_round():
    assert name(125.0, base=-BASE).order == -1
    assert name(750.0, base=-BASE).stationary_order == -5


def test_a_smeared_line_belongs_to_the_order_inside_it():
    """A harmonic that grows with a slow current has its power in side bands."""
    assert name(2969.0).order != 24
    assert name(2969.0, half_width=60.0).order == 24


def test_mechanical_orders_need_the_pole_pairs():
    assert "mechanical order 1:" in name(25.0, pole_pairs=5).cause
    assert name(-150.0, pole_pairs=5).order == pytest.approx(-1.2)
    assert "mechanical order −6:" in name(-150.0, pole_pairs=5).cause
    assert "no multiple" in name(25.0).cause


@pytest.mark.parametrize(
    ("frequency", "words"), [(727.0, "side band of +6×"), (725.0, "mechanical order 29:")]
)
def test_beside_a_harmonic_a_mechanical_order_has_to_be_met(frequency, words):
    """Slow currents smear a harmonic over the mechanical orders around it."""
    assert words in name(frequency, pole_pairs=5).cause


def test_without_a_frequency_nothing_is_named():
    assert [one.cause for one in named_lines([line(10.0)], 0.0)] == [""]


@pytest.mark.parametrize("turn", [0.08, -0.08])
def test_the_rotation_is_read_off_the_currents_matrix(turn):
    """Seen from a rotor that turns forwards, what stands still turns backwards."""
    cosine, sine = np.cos(turn), np.sin(turn)
    matrices = np.array([[[cosine, 1.5 * sine], [-sine / 1.5, cosine]]])
    assert signed_frequency(BASE, matrices) == np.sign(turn) * BASE


def test_a_drive_with_known_faults(rng):
    """A sensor's offset, unequal gains and a fifth harmonic of the phases, made in the phases."""
    turn = 2j * np.pi * BASE * STEP * np.arange(SAMPLES)
    phases = 0.3 + 0.2 * np.exp(-turn) + 0.5 * np.exp(-5 * turn)
    noise = 0.2 * rng.normal(size=(SAMPLES, 2)) @ np.array([1, 1j])
    frequency = np.fft.fftfreq(SAMPLES, STEP)
    power = power_spectrum((phases * np.exp(-turn) + noise)[:, None])
    order = np.argsort(frequency)
    lines = find_lines(frequency[order], power[order], BASE)
    found = named_lines(lines, BASE, pole_pairs=5)
    assert [(one.order, one.stationary_order) for one in found] == [(-6, -5), (-1, 0), (-2, -1)]
