"""Windows: they stay inside their recording, whatever the lengths, horizons and placements."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous, Jittered, Placement, Windows, cut
from penode.errors import InputError


def recording(samples: int, name: str = "run.csv", time_step: float = 1e-3) -> Experiment:
    """Make a recording whose x tells its sample and whose u tells ten times that."""
    k = np.arange(samples, dtype=np.float64)
    return Experiment(name, time_step, {"x": k, "u": 10.0 * k, "y": -k})


def cut_all(lengths: list[int], horizon: int, past: int, placement: Placement) -> Windows:
    runs = [recording(length, f"run{i}.csv") for i, length in enumerate(lengths)]
    return cut(runs, ["x"], ["u"], horizon, past=past, placement=placement)


shapes = st.tuples(st.integers(1, 40), st.integers(1, 5)).flatmap(
    lambda shape: st.tuples(
        st.just(shape[0]),
        st.just(shape[1]),
        st.lists(st.integers(sum(shape), sum(shape) + 200), min_size=1, max_size=4),
    )
)
placements = st.one_of(
    st.just(Contiguous()),
    st.builds(Jittered, st.integers(0, 2**40), st.one_of(st.none(), st.integers(1, 60))),
)


@settings(max_examples=200, deadline=None)
@given(shape=shapes, placement=placements)
def test_windows_never_leave_their_recording(shape, placement: Placement) -> None:
    horizon, past, lengths = shape
    windows = cut_all(lengths, horizon, past, placement)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    begin = windows.starts - past + 1
    end = windows.starts + horizon
    assert (begin >= offsets[windows.recording]).all()
    assert (end < offsets[windows.recording + 1]).all()
    assert set(windows.recording) == set(range(len(lengths)))
    assert (np.diff(windows.starts) > 0).all()
    assert (np.diff(windows.recording) >= 0).all()


@settings(max_examples=100, deadline=None)
@given(shape=shapes, seed=st.integers(0, 1000))
def test_jittered_draws_one_start_in_every_stratum(shape, seed: int) -> None:
    horizon, past, lengths = shape
    windows = cut_all(lengths, horizon, past, Jittered(seed))
    offset = 0
    for index, length in enumerate(lengths):
        starts = windows.starts[windows.recording == index]
        stratum = (starts - (offset + past - 1)) // horizon
        admissible = length - past - horizon + 1
        np.testing.assert_array_equal(stratum, np.arange(-(-admissible // horizon)))
        offset += length


def test_index_formula() -> None:
    windows = cut_all([60, 50], 7, 3, Jittered(4))
    for w, s in enumerate(windows.starts):
        i = windows.recording[w]
        k = s - 60 * i  # sample within its recording, which x repeats
        measured = windows.states[s - 2 : s + 1, 0]
        np.testing.assert_array_equal(measured, [k - 2, k - 1, k])
        np.testing.assert_array_equal(windows.states[s + 1 : s + 8, 0], k + np.arange(1, 8))
        np.testing.assert_array_equal(windows.inputs[s - 2 : s + 7, 0], 10 * (k + np.arange(-2, 7)))


def test_fields() -> None:
    windows = cut([recording(30, time_step=0.25)], ["y", "x"], ["u"], 4, past=2)
    np.testing.assert_array_equal(windows.states, np.stack([-np.arange(30), np.arange(30)], axis=1))
    assert windows.inputs.shape == (30, 1)
    assert (windows.horizon, windows.past, windows.time_step) == (4, 2, 0.25)
    assert len(windows) == len(windows.starts) == len(windows.recording) == 7
    assert windows.starts.dtype == windows.recording.dtype == np.int64
    assert windows.states.dtype == np.float64


def test_arrays_are_copied_and_read_only() -> None:
    x = np.arange(6.0).reshape(6, 1)
    windows = Windows(x, x, np.array([0]), np.array([0]), 5, 1, 1.0)
    x[:] = 9.0
    np.testing.assert_array_equal(windows.states[:, 0], np.arange(6.0))
    for array in (windows.states, windows.inputs, windows.starts, windows.recording):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_no_inputs_gives_empty_columns() -> None:
    assert cut([recording(20)], ["x"], [], 3).inputs.shape == (20, 0)


# --- placements -------------------------------------------------------------------------------


def test_contiguous_windows_lie_end_to_end() -> None:
    windows = cut_all([21, 12], 5, 2, Contiguous())
    np.testing.assert_array_equal(windows.starts, [1, 6, 11, 22, 27])
    np.testing.assert_array_equal(windows.recording, [0, 0, 0, 1, 1])


def test_contiguous_uses_the_last_admissible_start() -> None:
    np.testing.assert_array_equal(cut_all([11], 5, 1, Contiguous()).starts, [0, 5])
    np.testing.assert_array_equal(cut_all([10], 5, 1, Contiguous()).starts, [0])


def test_default_is_jittered_with_seed_zero() -> None:
    runs = [recording(500)]
    np.testing.assert_array_equal(
        cut(runs, ["x"], ["u"], 9).starts,
        cut(runs, ["x"], ["u"], 9, placement=Jittered(seed=0)).starts,
    )


@pytest.mark.parametrize("placement", [Jittered(3), Contiguous()])
def test_one_step_windows_use_every_sample_once(placement: Placement) -> None:
    windows = cut_all([20, 15], 1, 2, placement)
    np.testing.assert_array_equal(windows.starts, [*range(1, 19), *range(21, 34)])


def test_where_few_windows_fit_they_use_every_sample() -> None:
    for seed in range(5):
        starts = Jittered(seed, fewest=40).starts(1, 1200, 800)
        assert (starts[0], starts[-1]) == (1, 1200)
        assert len(np.unique(np.diff(starts))) > 1
    for many in (Jittered(3, fewest=40), Jittered(3, stride=5), Jittered(3)):
        starts = many.starts(1, 12000, 800)
        assert (starts[0], starts[-1]) != (1, 12000)


def test_jitter_is_reproducible_and_set_by_the_seed() -> None:
    first, again, other = (cut_all([4000], 13, 1, Jittered(seed)).starts for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5


def test_jitter_differs_between_recordings() -> None:
    windows = cut_all([4000, 4000], 13, 1, Jittered(0))
    first = windows.starts[windows.recording == 0]
    second = windows.starts[windows.recording == 1] - 4000
    assert len(first) == len(second)
    assert (first != second).mean() > 0.5


def test_jitter_is_uniform_within_its_strata() -> None:
    horizon, strata = 10, 20_000
    starts = Jittered(1).starts(0, horizon * strata - 1, horizon)
    assert len(starts) == strata
    share = np.bincount(starts % horizon, minlength=horizon) / strata
    # A share of 0.1 over 20 000 draws has a standard deviation of 0.0021.
    np.testing.assert_allclose(share, 0.1, atol=5 * 0.0021)
    pairs = np.corrcoef(starts[:-1] % horizon, starts[1:] % horizon)[0, 1]
    assert abs(pairs) < 5 / np.sqrt(strata)


@pytest.mark.parametrize("admissible", [12, 14])
def test_jitter_reaches_every_admissible_start(admissible: int) -> None:
    reached = {int(s) for seed in range(200) for s in Jittered(seed).starts(3, 2 + admissible, 4)}
    assert reached == set(range(3, 3 + admissible))


@pytest.mark.parametrize("stride", [1, 3, 12, 30])
def test_stride_draws_one_start_in_every_stratum_of_its_length(stride: int) -> None:
    """103 - 12 = 91 admissible starts after the second sample."""
    starts = cut_all([103], 12, 2, Jittered(7, stride)).starts
    np.testing.assert_array_equal((starts - 1) // stride, np.arange(-(-90 // stride)))
    assert starts[0] >= 1
    assert starts[-1] <= 90


def test_stride_below_the_horizon_makes_windows_overlap() -> None:
    horizon = 40
    alone, overlapping = (
        cut_all([2000], horizon, 1, Jittered(0, stride)).starts for stride in (None, 10)
    )
    assert len(alone) == 49
    assert len(overlapping) == 196
    assert np.diff(overlapping).max() < 20
    np.testing.assert_array_equal(alone, cut_all([2000], horizon, 1, Jittered(0, horizon)).starts)


def test_stride_keeps_recordings_apart() -> None:
    windows = cut_all([60, 50], 20, 3, Jittered(0, 5))
    assert list(np.bincount(windows.recording)) == [8, 6]
    assert windows.starts[windows.recording == 0].max() < 60 - 20
    assert windows.starts[windows.recording == 1].min() >= 60 + 2


@pytest.mark.parametrize("stride", [0, -4])
def test_stride_below_one_is_refused(stride: int) -> None:
    with pytest.raises(InputError, match=f"stride must be >= 1, got {stride}"):
        Jittered(0, stride)


def test_shortest_recording_gives_one_window() -> None:
    for placement in (Jittered(0), Contiguous()):
        np.testing.assert_array_equal(cut_all([9], 6, 3, placement).starts, [2])


def test_negative_seed_is_refused() -> None:
    with pytest.raises(InputError, match="seed must be >= 0, got -1"):
        Jittered(-1)


class Everywhere:
    """A placement that breaks its promise."""

    def starts(self, first: int, last: int, horizon: int) -> np.ndarray:
        return np.arange(first, last + 2)


class Backwards:
    """A placement that breaks its promise."""

    def starts(self, first: int, last: int, horizon: int) -> np.ndarray:
        return np.arange(first, last + 1)[::-1]


class Nowhere:
    """A placement that breaks its promise."""

    def starts(self, first: int, last: int, horizon: int) -> np.ndarray:
        return np.arange(0)


@pytest.mark.parametrize("placement", [Everywhere(), Backwards(), Nowhere()])
def test_a_placement_is_held_to_its_promise(placement: Placement) -> None:
    with pytest.raises(InputError, match=r"must lie within 0 \.\. 16"):
        cut([recording(20)], ["x"], ["u"], 3, placement=placement)


# --- refusals ---------------------------------------------------------------------------------


def test_short_recording_is_named() -> None:
    runs = [recording(50, "long.csv"), recording(11, "short.csv")]
    with pytest.raises(InputError, match=r"short\.csv: .*horizon 10.*2 past.*12 samples, got 11"):
        cut(runs, ["x"], ["u"], 10, past=2)


def test_time_steps_equal_but_for_rounding_agree() -> None:
    runs = [recording(50, "a.csv", 1e-4), recording(50, "b.csv", 1e-4 * (1 + 5e-7))]
    assert cut(runs, ["x"], ["u"], 5).time_step == 1e-4


@pytest.mark.parametrize("horizon", [0, -3])
def test_horizon_below_one(horizon: int) -> None:
    with pytest.raises(InputError, match=f"horizon must be >= 1, got {horizon}"):
        cut([recording(20)], ["x"], ["u"], horizon)


def test_past_below_one() -> None:
    with pytest.raises(InputError, match="past must be >= 1, got 0"):
        cut([recording(20)], ["x"], ["u"], 2, past=0)


def test_no_recording() -> None:
    with pytest.raises(InputError, match="one recording at least"):
        cut([], ["x"], ["u"], 2)


def test_missing_channel() -> None:
    with pytest.raises(InputError, match=r"run\.csv: no channel z"):
        cut([recording(20)], ["z"], ["u"], 2)


def test_value_not_finite() -> None:
    x = np.arange(20.0)
    x[6] = np.nan
    bad = Experiment("bad.csv", 1e-3, {"x": x, "u": np.arange(20.0)})
    with pytest.raises(InputError, match=r"bad\.csv: data row 7, channel x is nan"):
        cut([recording(20), bad], ["x"], ["u"], 2)


def test_thinning_keeps_every_nth_window_with_its_recording() -> None:
    windows = cut_all([60, 50], 4, 2, Jittered(3))
    thin = windows.among(slice(None, None, 3))
    np.testing.assert_array_equal(thin.starts, windows.starts[::3])
    np.testing.assert_array_equal(thin.recording, windows.recording[::3])
    assert (thin.horizon, thin.past, len(thin.states)) == (4, 2, 110)
    assert set(thin.recording) == {0, 1}


def test_the_draw_of_one_horizon_is_not_that_of_another() -> None:
    """With strata of one length, as overlapping windows have, rungs still start elsewhere."""
    first, other = (Jittered(0, 10).starts(0, 3999, horizon) for horizon in (20, 21))
    assert (first != other).mean() > 0.5
