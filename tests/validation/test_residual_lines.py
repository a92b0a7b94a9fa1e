"""Lines are found where they are, and not where there is noise alone."""

import numpy as np
import pytest

from penode.validation.residual_lines import find_lines, power_spectrum

STEP, SAMPLES = 1e-3, 4000


def turning(signal, base=None):
    """Return the lines of a complex signal (time,)."""
    frequency, power = np.fft.fftfreq(len(signal), STEP), power_spectrum(signal[:, None])
    order = np.argsort(frequency)
    return find_lines(frequency[order], power[order], base)


def one_sided(signal):
    """Return the lines of a real signal (time,)."""
    power = power_spectrum(signal[:, None])[: len(signal) // 2 + 1]
    power[1:-1] *= 2
    return find_lines(np.fft.rfftfreq(len(signal), STEP), power)


def complex_noise(rng, d=1.0, q=1.0):
    return rng.normal(size=(SAMPLES, 2)) @ np.array([d, 1j * q])


@pytest.mark.parametrize("frequency", [-123.4, 88.0, 0.0])
def test_a_rotating_vector_is_found_at_its_signed_frequency(rng, frequency):
    vector = 0.5 * np.exp(2j * np.pi * frequency * STEP * np.arange(SAMPLES))
    (line,) = turning(vector + complex_noise(rng, 0.7, 0.7), base=-40.0)
    assert line.frequency == pytest.approx(frequency, abs=0.1)
    assert line.order == pytest.approx(frequency / -40.0, abs=0.01)
    assert line.amplitude == pytest.approx(0.5, rel=0.1)
    assert line.share == pytest.approx(0.25 / (0.25 + 2 * 0.49), rel=0.15)
    assert line.low <= line.frequency <= line.high


def test_a_sinusoid_has_its_peak_amplitude(rng):
    (line,) = one_sided(
        0.8 * np.sin(2 * np.pi * 77.3 * STEP * np.arange(SAMPLES)) + rng.normal(size=SAMPLES)
    )
    assert line.frequency == pytest.approx(77.3, abs=0.1)
    assert line.amplitude == pytest.approx(0.8, rel=0.1)
    assert line.order is None


def test_an_offset_has_its_size(rng):
    (line,) = one_sided(0.5 + rng.normal(size=SAMPLES))
    assert line.low == 0.0
    assert line.amplitude == pytest.approx(0.5, rel=0.1)


def test_a_line_whose_size_changes_slowly_is_one_line(rng):
    """Side bands at the rate of the change belong to it."""
    time = STEP * np.arange(SAMPLES)
    size = 0.6 + 0.6 * np.sin(2 * np.pi * 1.1 * time)
    vector = size * np.exp(2j * np.pi * 150 * time)
    found = turning(vector + complex_noise(rng, 0.3, 0.3), base=25.0)
    assert [round(line.order) for line in found] == [6]
    assert found[0].low < 149.2
    assert found[0].high > 150.8


@pytest.mark.parametrize(("d", "q"), [(1.0, 1.0), (1.0, 0.2)])
def test_white_noise_has_no_line_but_in_one_recording_of_a_hundred(d, q):
    alarms = sum(bool(turning(complex_noise(np.random.default_rng(k), d, q))) for k in range(400))
    assert alarms <= 16


def test_coloured_noise_has_none_either():
    """The floor follows what is smooth."""
    alarms = 0
    for seed in range(200):
        noise = complex_noise(np.random.default_rng(seed))
        alarms += bool(turning(noise[1:] - 0.8 * noise[:-1]))
    assert alarms <= 10


def test_silence_has_none():
    assert turning(np.zeros(500, dtype=complex)) == ()
    assert one_sided(np.zeros(500)) == ()


def test_power_sums_to_the_mean_square(rng):
    values = rng.normal(size=(2000, 3))
    taper = np.hanning(2001)[:-1, None] ** 2
    expected = np.sum(taper * values**2, axis=0) / taper.sum()
    np.testing.assert_allclose(power_spectrum(values).sum(axis=0), expected, rtol=1e-12)
