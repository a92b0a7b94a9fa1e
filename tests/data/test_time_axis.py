"""The time step: rounding passes, everything else that is not uniform is refused by row."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from penode.data.time_axis import uniform_step
from penode.errors import InputError


def refusal(t: np.ndarray) -> str:
    with pytest.raises(InputError) as caught:
        uniform_step("run.csv", t)
    assert str(caught.value).startswith("run.csv")
    return str(caught.value)


@settings(max_examples=100, deadline=None)
@given(
    step=st.floats(1e-5, 1.0),
    begin=st.floats(-100.0, 100.0),
    samples=st.integers(8, 3000),
)
def test_uniform_times_give_their_step(step: float, begin: float, samples: int) -> None:
    t = begin + step * np.arange(samples)
    assert uniform_step("run.csv", t) == (t[-1] - t[0]) / (samples - 1)


@settings(max_examples=100, deadline=None)
@given(
    step=st.floats(1.0, 30.0),
    decimals=st.integers(0, 7),
    begin=st.floats(0.0, 50.0),
    samples=st.integers(8, 3000),
)
def test_times_rounded_to_fixed_decimals_pass(
    step: float, decimals: int, begin: float, samples: int
) -> None:
    quantum = 10.0**-decimals
    t = np.round((begin + (4.5 + step) * np.arange(samples)) * quantum, decimals)
    got = uniform_step("run.csv", t)
    assert got == pytest.approx((4.5 + step) * quantum, abs=1.001 * quantum / (samples - 1))


@pytest.mark.parametrize("rate", [7_000.0, 15_000.0, 16_000.0])
def test_six_significant_digits_pass(rate: float) -> None:
    # 9 s at the most: the sixth digit is 1e-5 s there, a seventh to a sixth of the step.
    t = np.array([float(f"{k / rate:.6g}") for k in range(int(9.0 * rate))])
    assert np.abs(np.diff(t) * rate - 1.0).max() > 0.01
    assert uniform_step("run.csv", t) == pytest.approx(1 / rate, rel=1e-5)


def test_six_decimals_at_odd_rate_pass() -> None:
    t = np.round(np.arange(20_000) / 30_000.0, 6)
    assert np.abs(np.diff(t) * 30_000.0 - 1.0).max() > 0.01
    assert uniform_step("run.csv", t) == pytest.approx(1 / 30_000.0, rel=1e-5)


def test_single_precision_passes() -> None:
    t = (np.arange(20_000) * 1e-4 + 60.0).astype(np.float32).astype(np.float64)
    assert np.abs(np.diff(t) / 1e-4 - 1.0).max() > 0.01
    assert uniform_step("run.parquet", t) == pytest.approx(1e-4, rel=1e-5)


def test_jitter_below_one_percent_passes() -> None:
    rng = np.random.default_rng(0)
    t = (np.arange(500) + rng.uniform(-0.004, 0.004, 500)) * 1e-3
    assert uniform_step("run.csv", t) == pytest.approx(1e-3, rel=1e-4)


@pytest.mark.parametrize("samples", [1, 3, 7])
def test_too_few_samples(samples: int) -> None:
    sentence = refusal(np.arange(samples) * 0.1)
    assert f"at least 8 samples, got {samples}" in sentence
    assert "8" in sentence


def test_eight_samples_suffice() -> None:
    assert uniform_step("run.csv", np.arange(8) * 0.5) == 0.5


def test_repeated_time_is_named() -> None:
    t = np.arange(20) * 0.1
    t[11] = t[10]
    sentence = refusal(t)
    assert "repeats at data row 12" in sentence
    assert "remove" in sentence


def test_decreasing_time_is_named() -> None:
    t = np.arange(20) * 0.1
    t[5] = 0.05
    assert "decreases at data row 6" in refusal(t)
    assert "decreases at data row 2" in refusal(t[::-1])


@pytest.mark.parametrize("decimals", [1, 2, 6, 15])
@pytest.mark.parametrize("lost", [1, 7])
def test_gap_is_named(lost: int, decimals: int) -> None:
    t = np.round(np.delete(np.arange(200) * 0.1, np.arange(50, 50 + lost)), decimals)
    sentence = refusal(t)
    assert "gap between data rows 50 and 51" in sentence
    assert f"about {lost} missing rows" in sentence


def test_gap_is_named_among_rounded_times() -> None:
    t = np.round(np.delete(np.arange(3000) / 15_000.0, 1234), 5)
    assert "gap between data rows 1234 and 1235" in refusal(t)


@pytest.mark.parametrize("decimals", [5, 6, 15])
def test_jitter_is_named(decimals: int) -> None:
    t = np.arange(200) * 1e-3
    t[120] += 2e-5
    t[120:] -= 1e-5 * (decimals == 5)  # keep a single quantum from hiding in the rounding
    sentence = refusal(np.round(t + 3e-5 * np.sin(np.arange(200)), decimals))
    assert "jitters" in sentence
    assert "data rows" in sentence
    assert "1 %" in sentence


def test_late_sample_is_named() -> None:
    t = np.arange(200) * 1e-3
    t[120] += 3e-5
    assert "between data rows 1" in refusal(t)
    assert "between data rows 120 and 121" in refusal(t) or "121 and 122" in refusal(t)


def test_drifting_clock_is_refused() -> None:
    t = np.cumsum(np.linspace(1.0, 1.1, 500)) * 1e-3
    assert "jitters" in refusal(t)


def test_times_too_coarse_for_the_step_are_refused() -> None:
    assert "more digits" in refusal(np.round(np.arange(1000) / 8000.0, 4))


def test_times_beyond_reason_are_refused_and_tiny_ones_do_not_overflow():
    with pytest.raises(InputError, match=r"^run.csv: t must be at most 1e\+12 s, got 1.1e\+300 s"):
        uniform_step("run.csv", np.arange(12) * 1e299)
    tiny = np.arange(12) * 1e-310
    tiny[5] *= 1.04
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match="t jitters"):
            uniform_step("run.csv", tiny)
