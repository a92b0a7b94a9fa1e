"""Quality checks: they report what is there and keep quiet about sound signals."""

import numpy as np
import pytest

from penode.data import gathered
from penode.data.excitation import check_excitation
from penode.data.experiment import Experiment
from penode.data.quality import find_clipping, find_stuck, inspect
from penode.errors import InputError


def recording(**channels: np.ndarray) -> Experiment:
    return Experiment("run.csv", 1e-3, channels)


def sine(samples: int = 2000, noise: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.sin(0.0123 * np.arange(samples)) + noise * rng.standard_normal(samples)


def test_constant_channel_is_refused() -> None:
    run = recording(x=sine(), u=np.full(2000, 3.25))
    check_excitation(run, ["x"])
    with pytest.raises(InputError, match=r"run\.csv: channel u is constant at 3\.25 .*moving u"):
        check_excitation(run, ["x", "u"])


def test_constant_but_for_rounding_is_refused() -> None:
    u = np.full(100, 0.1)
    u[::2] = 0.3 - 0.2
    assert np.ptp(u) > 0.0
    with pytest.raises(InputError, match="constant"):
        check_excitation(recording(u=u), ["u"])


def test_constant_zero_is_refused() -> None:
    with pytest.raises(InputError, match="constant at 0"):
        check_excitation(recording(u=np.zeros(100)), ["u"])


def test_small_motion_on_a_large_value_passes() -> None:
    check_excitation(recording(u=1e4 + 1e-5 * sine()), ["u"])


def test_missing_channel_is_named() -> None:
    for check in (check_excitation, inspect):
        with pytest.raises(InputError, match=r"run\.csv: no channel y"):
            check(recording(x=sine()), ["y"])


def test_stuck_samples_are_found_with_their_rows() -> None:
    x = sine(noise=0.1)
    x[700:760] = x[700] = 0.2
    finding = find_stuck(recording(x=x), "x")
    assert finding is not None
    assert finding.severity == "warning"
    assert "run.csv: channel x" in finding.sentence
    assert "60 samples (data rows 701 to 760)" in finding.sentence


def test_clipping_is_found_on_either_side() -> None:
    for sign, word in ((1.0, "largest"), (-1.0, "smallest")):
        x = sign * np.minimum(sine(), 0.8)
        finding = find_clipping(recording(x=x), "x")
        assert finding is not None
        assert finding.severity == "warning"
        count = np.sum(x == sign * 0.8)
        assert f"{word} value {sign * 0.8:g} in {count} of 2000 samples" in finding.sentence


@pytest.mark.parametrize(
    "signal",
    [
        sine(),
        np.round(sine(20_000), 3),  # a quantised sine dwells longest at its peaks
        np.floor(sine(20_000) * 512),
        np.repeat(np.random.default_rng(0).integers(0, 2, 200), 10),  # a binary test signal
        np.repeat(np.random.default_rng(1).standard_normal(50), 40),  # a staircase
        np.maximum(np.arange(2000.0) - 500, 0.0),  # rest, then motion
        np.random.default_rng(2).standard_normal(2000),
    ],
    ids=["sine", "rounded", "converter", "binary", "stairs", "rest", "noise"],
)
def test_sound_signals_raise_no_finding(signal: np.ndarray) -> None:
    assert inspect(recording(x=signal), ["x"]) == ()


def test_inspect_reports_in_the_order_of_channels_and_changes_nothing() -> None:
    run = recording(x=np.minimum(sine(), 0.8), u=np.ones(2000), y=sine())
    before = {name: values.copy() for name, values in run.channels.items()}
    found = inspect(run, ["x", "u", "y"])
    assert [(each.channel, each.severity) for each in found] == [("x", "warning"), ("u", "error")]
    for name, values in run.channels.items():
        np.testing.assert_array_equal(values, before[name])


@pytest.mark.parametrize(("run", "usual", "found"), [(20, 1, True), (19, 1, False), (39, 2, False)])
def test_a_channel_is_stuck_from_twenty_times_its_usual_dwell(run: int, usual: int, found: bool):
    x = np.repeat(np.random.default_rng(3).standard_normal(400), usual)
    x[100 : 100 + run] = 0.5 * (x[99] + x[100 + run])
    x[0], x[-1] = -9.0, 9.0
    assert (find_stuck(recording(x=x), "x") is not None) == found


@pytest.mark.parametrize("extreme", [9.0, -9.0])
def test_a_channel_that_stands_at_its_extreme_is_not_stuck(extreme: float) -> None:
    x = sine(noise=0.1)
    x[700:760] = extreme
    assert find_stuck(recording(x=x), "x") is None
    finding = find_clipping(recording(x=x), "x")
    assert finding is not None
    assert "in 60 of 2000 samples" in finding.sentence


@pytest.mark.parametrize(("at", "beside", "found"), [(10, 1, True), (9, 1, False), (19, 2, False)])
def test_a_value_is_clipped_from_ten_times_its_neighbours_count(at: int, beside: int, found: bool):
    x = np.concatenate([np.linspace(-1, 0.9, 500), np.full(beside, 0.95), np.full(at, 1.0)])
    assert (find_clipping(recording(x=x), "x") is not None) == found


def test_resting_at_zero_is_no_clipping() -> None:
    ramp = np.arange(1.0, 500.0)
    for sign in (1.0, -1.0):
        x = sign * np.concatenate([np.zeros(60), ramp])
        assert find_clipping(recording(x=x), "x") is None
        assert find_clipping(recording(x=x + sign), "x") is not None


# --- in pieces ----------------------------------------------------------------------------------


def longest_run(x: np.ndarray) -> tuple[int, int, float]:
    """Return begin, length and median length of runs away from the extremes, by definition."""
    begin = [k for k in range(len(x)) if k == 0 or x[k] != x[k - 1]]
    length = np.diff([*begin, len(x)])
    inner = [n if x.min() < x[k] < x.max() else 0 for k, n in zip(begin, length, strict=True)]
    at = int(np.argmax(inner))
    return begin[at], inner[at], float(np.median(length))


@pytest.mark.parametrize("piece", [1, 7, 64, 5000])
@pytest.mark.parametrize("seed", range(8))
def test_pieces_find_what_the_whole_shows(piece: int, seed: int, monkeypatch) -> None:
    rng = np.random.default_rng(seed)
    x = np.round(rng.normal(size=600), 1 + seed % 3)
    place, run = int(rng.integers(0, 500)), int(rng.integers(10, 90))
    x[place : place + run] = 0.25
    for word, limit in (("largest", 1.4), ("smallest", -1.4)):
        clipped = np.minimum(x, limit) if word == "largest" else np.maximum(x, limit)
        end = max if word == "largest" else min
        at, beside = end(clipped), end(clipped[clipped != end(clipped)])
        expected = np.sum(clipped == at) >= max(10, 10 * np.sum(clipped == beside))
        monkeypatch.setattr(gathered, "PIECE", piece)
        finding = find_clipping(recording(x=clipped), "x")
        assert (finding is not None) == expected
        if finding is not None:
            assert (
                f"its {word} value {limit:.6g} in {np.sum(clipped == at)} of 600"
                in finding.sentence
            )
    begin, length, usual = longest_run(x)
    stuck = find_stuck(recording(x=x), "x")
    assert (stuck is not None) == (length >= max(20, 20 * usual))
    if stuck is not None:
        assert f"data rows {begin + 1} to {begin + length})" in stuck.sentence
