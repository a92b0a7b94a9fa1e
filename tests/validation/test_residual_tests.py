"""The spectrum of a known residual."""

import numpy as np
import pytest

from penode.validation.free_run import Comparison
from penode.validation.residual_tests import residual_spectrum

SAMPLES, STEP = 1000, 1e-3


def spectrum_of(residual, step=STEP):
    """Return the spectrum of a one-step residual (time, state); row 0 is no prediction."""
    rows = np.vstack([np.full((1, residual.shape[1]), 1e6), residual])
    zeros = np.zeros_like(rows)
    states = tuple(f"x{k}" for k in range(residual.shape[1]))
    comparison = Comparison("run.csv", "train", step, states, states, rows, zeros, zeros)
    return residual_spectrum(comparison)


def test_a_sinusoid_has_its_amplitude_at_its_frequency():
    time = STEP * np.arange(SAMPLES)
    residual = np.stack(
        [3.0 * np.cos(2 * np.pi * 50 * time + 0.3), 0.2 * np.sin(2 * np.pi * 120 * time)], axis=1
    )
    found = spectrum_of(residual)
    assert found.recording == "run.csv"
    np.testing.assert_allclose(found.frequency, np.arange(501.0), atol=1e-9)
    assert found.amplitude.shape == (501, 2)
    for state, (frequency, amplitude) in enumerate([(50, 3.0), (120, 0.2)]):
        assert np.argmax(found.amplitude[:, state]) == frequency
        assert found.amplitude[frequency, state] == pytest.approx(amplitude, rel=1e-9)
        away = np.abs(found.frequency - frequency) > 1.5
        assert found.amplitude[away, state].max() < 1e-9


def test_between_two_lines_the_hann_window_loses_15_percent_at_most():
    time = STEP * np.arange(SAMPLES)
    found = spectrum_of(np.cos(2 * np.pi * 50.5 * time)[:, None])
    assert 0.84 < found.amplitude.max() < 0.86


def test_an_offset_has_its_size_at_zero():
    found = spectrum_of(np.full((SAMPLES, 1), 0.7))
    assert found.amplitude[0, 0] == pytest.approx(0.7)


@pytest.mark.parametrize(("samples", "step"), [(1000, 1e-3), (14, 0.1), (36, 1e-3)])
def test_an_alternating_residual_has_its_size_at_half_the_rate(samples, step):
    """Whatever the rounding of the last frequency."""
    residual = 0.4 * (-1.0) ** np.arange(samples)[:, None]
    found = spectrum_of(residual, step)
    assert found.frequency[-1] == pytest.approx(0.5 / step)
    assert found.amplitude[-1, 0] == pytest.approx(0.4)
