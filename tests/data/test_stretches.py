"""Recordings with gaps: read as stretches on one clock, of which nothing crosses into another."""

import itertools
import pickle

import numpy as np
import pytest

from penode import save
from penode.data.experiment import Experiment
from penode.data.load import load, load_stretches
from penode.data.mapping import Origin, map_channels
from penode.data.quality import inspect_stretches
from penode.data.stretches import (
    by_recording,
    check_lengths,
    excerpt,
    fewest_windows,
    listed,
    reasons_of,
    recording_numbers,
    spans_of,
)
from penode.data.table import Table
from penode.data.windows import Contiguous, cut
from penode.errors import InputError

STEP = 1e-4


def written(tmp_path, kept, name="run.csv", times=None):
    """Write a recording of which some rows were kept; x is the row in the recording."""
    rows = np.flatnonzero(kept)
    times = rows * STEP if times is None else times
    path = tmp_path / name
    columns = np.column_stack([times, rows, np.sin(0.1 * rows)])
    np.savetxt(path, columns, delimiter=",", header="t,x,y", comments="", fmt="%.10g")
    return path


def without(samples, *lost):
    kept = np.ones(samples, dtype=bool)
    for first, last in lost:
        kept[first:last] = False
    return kept


def refusal(path):
    with pytest.raises(InputError) as caught:
        load_stretches(path)
    return str(caught.value)


# --- reading ------------------------------------------------------------------------------------


def test_what_lies_between_gaps_is_a_stretch_on_the_clock_of_the_recording(tmp_path):
    path = written(tmp_path, without(2000, (500, 501), (900, 1400)))
    found = load_stretches(path)
    assert [e.name for e in found] == [
        "run.csv rows 1 to 500",
        "run.csv rows 501 to 899",
        "run.csv rows 900 to 1499",
    ]
    begins = (0, 501, 1400)
    for experiment, begin in zip(found, begins, strict=True):
        x = experiment.channels["x"]
        np.testing.assert_array_equal(x, begin + np.arange(len(experiment)))
        assert experiment.place.start == pytest.approx(begin * STEP, abs=1e-12)
        assert experiment.place.duration == pytest.approx(1999 * STEP, rel=1e-9)
        assert experiment.place.recording == "run.csv"
        assert experiment.time_step == pytest.approx(STEP, rel=1e-9)
    assert reasons_of(found) == (
        "run.csv: 2 gaps of 0.0001 to 0.05 s in time, after data rows 500, 899: read as "
        "3 stretches, and nothing is predicted across a gap.",
    )


def test_a_recording_without_gaps_is_one_whole(tmp_path):
    (whole,) = load_stretches(written(tmp_path, without(400)))
    assert whole.stretch is None
    assert whole.name == "run.csv"
    assert reasons_of([whole]) == ()


def test_one_piece_is_refused_where_there_are_several_and_says_what_to_call(tmp_path):
    with pytest.raises(InputError, match=r"run.csv: a gap of 0.01 s .* Take its stretches with"):
        load(written(tmp_path, without(800, (300, 400))))


def test_short_stretches_are_left_out_and_counted(tmp_path):
    found = load_stretches(written(tmp_path, without(1200, (300, 310), (400, 410))))
    assert [len(e) for e in found] == [300, 790]
    assert "2 gaps of 0.001 s in time, after data rows 300, 390" in found[0].place.reasons[0]
    assert "90 samples that are fewer than 200 in a row are left out." in found[0].place.reasons[0]
    assert found[1].place.row == 390


def test_a_sample_alone_between_two_gaps_is_left_out(tmp_path):
    found = load_stretches(written(tmp_path, without(1200, (300, 310), (311, 320))))
    assert [len(e) for e in found] == [300, 880]
    assert found[0].place.reasons[0].endswith("A sample that stands alone is left out.")


def test_a_recording_that_is_gaps_for_the_most_part_is_refused(tmp_path):
    lost = [(100, 150), *((k, k + 5) for k in range(250, 3000, 105))]
    assert "t has a gap between data rows 100 and 101" in refusal(
        written(tmp_path, without(3000, *lost))
    )


def test_stretches_of_two_rates_are_refused(tmp_path):
    times = np.concatenate([np.arange(500) * STEP, 1.0 + np.arange(500) * 1.2 * STEP])
    sentence = refusal(written(tmp_path, without(1000), times=times))
    assert "the time step is 0.0001 s from data row 1 and 0.00012 s from data row 501" in sentence


def test_jitter_beside_a_gap_is_refused_by_its_row_in_the_file(tmp_path):
    times = np.flatnonzero(without(1100, (500, 600))) * STEP
    times[700] += 0.3 * STEP
    sentence = refusal(written(tmp_path, without(1000), times=times))
    assert "jitters: the step between data rows 70" in sentence


def test_a_late_sample_is_no_gap(tmp_path):
    times = np.arange(1000) * STEP
    times[500] += 0.7 * STEP
    assert "jitters" in refusal(written(tmp_path, without(1000), times=times))


@pytest.mark.parametrize(("a", "b"), [(0, 2), (0, -3), (1, -2)])
def test_a_delay_takes_no_value_from_beyond_a_gap(a, b):
    """Both columns hold the time; a late one holds that of so many samples before."""
    kept = np.flatnonzero(without(1000, (300, 420), (800, 801)))
    clock = np.arange(1000)
    columns = {"t": kept * STEP, "a": (clock - a)[kept] * 1.0, "b": (clock - b)[kept] * 1.0}
    # What a logger wrote after the gap lags behind within its own stretch all the same.
    mapped = map_channels(
        "run.csv", Table(columns, {}), {"a": Origin("a", delay=a), "b": Origin("b", delay=b)}
    )
    assert len(mapped.spans) == 2  # 199 samples at the end are too few
    for first, last in mapped.spans:
        at = mapped.times[first:last] / STEP
        for name in "ab":
            np.testing.assert_allclose(mapped.channels[name][first:last], at, atol=1e-6)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_saved_recording_has_no_gaps(tmp_path, suffix):
    run = Experiment("run", STEP, {"x": np.arange(900.0), "y": np.sin(0.1 * np.arange(900))})
    save(run, tmp_path / f"run{suffix}")
    (whole,) = load_stretches(tmp_path / f"run{suffix}")
    assert whole.stretch is None


# --- places -------------------------------------------------------------------------------------


def test_a_part_of_a_part_is_a_stretch_of_the_recording():
    run = Experiment("run", STEP, {"x": np.arange(1000.0)})
    inner = run.part(100, 600).between(50, 250, "Because.")
    assert inner.name == "run rows 151 to 350"
    assert inner.place.row == 150
    assert inner.place.start == pytest.approx(0.015)
    assert inner.place.duration == pytest.approx(0.0999)
    assert inner.place.reasons == ("Because.",)
    again = pickle.loads(pickle.dumps(inner))
    assert again.stretch == inner.stretch
    np.testing.assert_array_equal(again.channels["x"], np.arange(150.0, 350.0))


def test_stretches_belong_together_and_whole_recordings_stand_alone():
    one, other = (Experiment("run", STEP, {"x": np.arange(1000.0)}) for _ in range(2))
    experiments = [one, other.part(0, 300), other.part(500, 900), one]
    assert recording_numbers(experiments).tolist() == [0, 1, 1, 2]
    assert [len(group) for group in by_recording(experiments)] == [1, 2, 1]


def test_runs_are_those_that_are_long_enough():
    one, other = (Experiment("run", STEP, {"x": np.zeros(n)}) for n in (1000, 500))
    usable = without(1000, (0, 1), (250, 252), (400, 401), (700, 1000)), np.zeros(500, dtype=bool)
    assert spans_of([one, other], usable) == [(one, 1, 250), (one, 401, 700)]
    assert spans_of([other, one], [usable[1], ~np.zeros(1000, dtype=bool)]) == [(one, 0, 1000)]


def test_places_are_listed_up_to_three():
    assert listed([7]) == "data row 7"
    assert listed([1, 2, 3, 4, 5]) == "data rows 1, 2, 3 and 2 more"


# --- what is done with them ---------------------------------------------------------------------


def test_no_window_crosses_a_gap_and_short_stretches_have_none():
    run = Experiment("run", STEP, {"x": np.arange(1000.0), "u": np.zeros(1000)})
    stretches = [run.part(0, 300), run.part(400, 640), run.part(700, 1000)]
    windows = cut(stretches, ["x"], ["u"], 250, placement=Contiguous())
    assert windows.recording.tolist() == [0, 2]
    for start in windows.starts:
        ahead = windows.states[start : start + 251, 0]
        np.testing.assert_array_equal(np.diff(ahead), 1.0)
    assert fewest_windows(stretches, 100) == 3 + 2 + 3
    check_lengths(stretches, 299, 1)
    with pytest.raises(
        InputError, match="horizon 300 with 1 past samples needs at least 301 samples, got 300"
    ):
        cut(stretches, ["x"], ["u"], 300)
    with pytest.raises(InputError, match="got 240"):
        check_lengths([run, run.part(400, 640)], 299, 1)


def test_a_channel_may_stand_still_in_a_stretch_but_not_in_all():
    x = np.sin(0.01 * np.arange(1000))
    x[:400] = 2.0
    run = Experiment("run", STEP, {"x": x})
    rest, more_rest, moving = run.part(0, 200), run.part(200, 400), run.part(400, 1000)
    assert inspect_stretches([rest, moving], ["x"]) == ()
    (finding,) = inspect_stretches([rest, more_rest], ["x"])
    assert finding.severity == "error"


def test_a_long_recording_with_gaps_is_drawn_from_as_a_whole():
    random = np.random.default_rng(0)
    run = Experiment("run", STEP, {"x": random.standard_normal(100_000)})
    edges = np.arange(0, 100_001, 500)
    stretches = [run.part(a, b - 3) for a, b in itertools.pairwise(edges)]
    used = excerpt(stretches, ["x"], 20_000)
    samples = sum(map(len, used.experiments))
    assert 19_000 < samples <= 20_000
    rows = [e.place.row for e in used.experiments]
    assert rows == sorted(rows)
    assert {row // 20_000 for row in rows} == set(range(5))
    assert all(e in stretches for e in used.experiments)


def test_times_with_gaps_give_stretches_that_keep_them():
    t = 5.0 + 0.01 * np.arange(300)
    kept = np.r_[0:100, 130:134, 150:300]
    found = Experiment.from_times("run", t[kept], {"x": np.arange(300.0)[kept]})
    assert [len(one) for one in found] == [100, 150]
    assert found[0].time_step == pytest.approx(0.01, rel=1e-9)
    for one, first in zip(found, (0, 150), strict=True):
        assert np.allclose(one.times, t[first : first + len(one)], atol=1e-12)
        assert one.channels["x"][0] == first
        assert one.place.recording == "run"
    (reason,) = found[1].place.reasons
    assert "2 gaps of 0.16 to 0.3 s" in reason
    assert "4 samples that are fewer than 8 in a row are left out" in reason


def test_times_without_gaps_give_the_recording():
    t = 0.01 * np.arange(50)
    (whole,) = Experiment.from_times("run", t, {"x": t})
    assert whole.stretch is None
    (later,) = Experiment.from_times("run", t + 2.0, {"x": t})
    assert np.allclose(later.times, t + 2.0, atol=1e-12)
    assert np.allclose(later.part(10, 20).times, t[10:20] + 2.0, atol=1e-12)


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (np.r_[0:20, 19:40] * 0.1, "repeats at data row 21"),
        (np.arange(40) * 0.1 + 0.03 * (np.arange(40) % 2), "jitters"),
        (np.r_[np.arange(20) * 0.1, 5 + np.arange(20) * 0.12], "time step is 0.1 s"),
        (np.arange(39) * 0.1, "got 39 times"),
        (np.full(40, np.nan), "must be numbers"),
    ],
)
def test_times_of_no_uniform_stretches_are_refused(times, words):
    with pytest.raises(InputError, match=words):
        Experiment.from_times("run", times, {"x": np.zeros(len(times) // 2 * 2 or 2)})
