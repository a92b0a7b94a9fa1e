"""The spectrum of a known residual, and its correlations."""

import numpy as np
import pytest
from scipy.signal import lfilter

from penode import Experiment
from penode.validation.comparison import Comparison
from penode.validation.residual_tests import residual_correlations, residual_spectrum

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


# --- correlations -----------------------------------------------------------------------------

LONG = 20_000


def correlations_of(residual, drive):
    """Test a residual (time, 1) beside an input (time,)."""
    rows = np.vstack([np.zeros((1, 1)), residual])
    comparison = Comparison("run.csv", "train", STEP, ("x",), ("m",), rows, 0 * rows, 0 * rows)
    held = {"u": np.append(drive, 0.0), "still": np.ones(LONG + 1)}
    return residual_correlations(comparison, Experiment("run.csv", STEP, held), ("u", "still"))


def coloured(random, pole):
    return lfilter([1.0], [1.0, -pole], random.normal(size=LONG))


def test_white_noise_stays_within_the_limit_at_99_of_100_lags():
    random, beyond = np.random.default_rng(4), []
    for _ in range(30):
        found = correlations_of(random.normal(size=(LONG, 1)), coloured(random, 0.9))
        beyond.append(np.abs(found.own[1:, 0]) > found.own_limit)
        assert found.own[0, 0] == pytest.approx(1.0)
    # 1770 lags know the share to 0.25 %.
    assert 0.003 < np.mean(beyond) < 0.018


@pytest.mark.parametrize("poles", [(0.0, 0.9), (0.9, 0.0), (0.95, 0.95), (-0.8, 0.9)])
def test_unrelated_signals_stay_within_the_limit_whatever_their_memory(poles):
    random, beyond = np.random.default_rng(5), []
    for _ in range(60):
        residual, drive = (coloured(random, pole) for pole in poles)
        found = correlations_of(residual[:, None], drive)
        beyond.append(np.abs(found.cross[0, 0]) > found.cross_limit[0])
        assert found.inputs == ("u",)  # one that stands still has no correlation
    # 60 recordings; lags of one recording say much the same.
    assert np.mean(beyond) < 0.06


def test_memory_and_what_is_left_of_an_input_are_found():
    random = np.random.default_rng(6)
    drive, noise = random.normal(size=(2, LONG))
    residual = lfilter([1.0], [1.0, -0.5], noise)
    residual[3:] += 0.2 * drive[:-3]
    found = correlations_of(residual[:, None], drive)
    power = 1 / 0.75 + 0.04
    np.testing.assert_allclose(found.own[1, 0], (0.5 / 0.75) / power, atol=0.02)
    late = int(np.argmax(np.abs(found.cross[:, 0, 0])))
    assert late == 3
    np.testing.assert_allclose(found.cross[late, 0, 0], 0.2 / np.sqrt(power), atol=0.02)
    assert found.cross[late, 0, 0] > found.cross_limit[0, 0]


def test_states_without_prediction_are_left_out():
    rows = np.vstack([np.zeros((1, 2)), np.random.default_rng(7).normal(size=(LONG, 2))])
    blind = rows * np.array([1.0, np.nan])
    names = ("x", "v")
    comparison = Comparison("run.csv", "train", STEP, names, names, rows, blind - 1.0, 0 * rows)
    held = Experiment("run.csv", STEP, {"u": rows[:, 0]})
    assert residual_correlations(comparison, held, ("u",)).states == ("x",)
    comparison = Comparison("run.csv", "train", STEP, names, names, rows, np.nan * rows, 0 * rows)
    assert residual_correlations(comparison, held, ("u",)).states == ()


# --- over the value of a channel --------------------------------------------------------------


def over(channels, residual):
    """Return the residual (time, state) over channels (time,)."""
    rows = np.vstack([np.zeros((1, residual.shape[1])), residual])
    zeros = np.zeros_like(rows)
    comparison = Comparison("a", "train", STEP, ("x", "y"), ("A", "A"), rows, zeros, zeros)
    run = Experiment("a", STEP, {name: np.append(v[0], v) for name, v in channels.items()})
    return residual_correlations(comparison, run, ()).over


def test_what_goes_with_a_channel_is_its_mean_there(rng):
    speed = rng.uniform(100.0, 300.0, 40_000)
    noise = rng.normal(0.0, 0.5, (40_000, 2))
    still = np.full(40_000, 7.0)
    residual = noise + np.stack([0.01 * (speed - 200), np.where(speed > 250, 2.0, 0.0)], axis=1)
    (found,) = over({"speed": speed, "still": still, "x": speed}, residual)
    assert found.channel == "speed"
    np.testing.assert_allclose(found.value[[0, -1]], [102.5, 297.5], atol=0.01)
    np.testing.assert_allclose(found.mean[:, 0], 0.01 * (found.value - 200), atol=0.1)
    np.testing.assert_allclose(found.mean[:, 1], np.where(found.value > 250, 2.0, 0.0), atol=0.1)
    expected = np.sqrt(0.25 + np.where(found.value > 250, 4.0, 0.0))
    np.testing.assert_allclose(found.rms[:, 1], expected, rtol=0.08)


def test_stretches_of_few_samples_and_channels_of_no_use_are_left_out(rng):
    values = np.append(np.full(100, 1.0), [2.0, 2.1])
    residual = rng.normal(0.0, 1.0, (102, 2))
    (found,) = over({"u": values, "bad": np.append(values[:-1], np.nan)}, residual)
    assert np.isfinite(found.mean[0]).all()
    assert np.isnan(found.mean[1:]).all()
    assert found.mean[0] == pytest.approx(residual[:100].mean(axis=0))
    assert over({"u": np.linspace(0, 1, 102)}, residual) == ()
