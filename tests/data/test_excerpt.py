"""Stretches of long recordings: spread over their length and over what the channels do there."""

import itertools

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.data.stretches import excerpt
from penode.errors import InputError

LENGTH = 2000
BLOCKS = 40


def recording(seed: int = 0, name: str = "run.csv") -> Experiment:
    """Forty blocks of sines whose amplitude and mean are drawn anew for each."""
    random = np.random.default_rng(seed)
    t = np.arange(BLOCKS * LENGTH)
    amplitude = np.repeat(random.uniform(0.5, 1.0, BLOCKS), LENGTH)
    mean = np.repeat(random.uniform(-1.0, 1.0, BLOCKS), LENGTH)
    x = mean + amplitude * np.sin(0.05 * t)
    return Experiment(name, 1e-3, {"x": x, "y": np.cos(0.03 * t), "other": t * 1.0})


def rows(part: Experiment) -> tuple[int, int]:
    first, last = part.name.rpartition(" rows ")[2].split(" to ")
    return int(first) - 1, int(last)


def test_what_is_not_too_long_is_used_whole():
    runs = (recording(), recording(1))
    used = excerpt(runs, ["x"], 2 * BLOCKS * LENGTH)
    assert used.experiments == runs
    assert used.sentence == ""


def test_what_is_hardly_too_long_is_used_whole():
    run = recording()
    used = excerpt([run], ["x"], (BLOCKS - 1) * LENGTH + 1, length=10 * LENGTH)
    assert used.experiments != (run,)
    used = excerpt([run.part(0, 10 * LENGTH + 7)], ["x"], 10 * LENGTH, length=LENGTH)
    assert len(used.experiments) == 1
    assert used.sentence == ""


def test_stretches_are_those_samples_of_the_recording_in_order_and_apart():
    run = recording()
    used = excerpt([run], ["x", "y"], 10 * LENGTH, length=LENGTH)
    places = [rows(part) for part in used.experiments]
    assert len(places) == 10
    assert all(last - first == LENGTH for first, last in places)
    assert all(a[1] <= b[0] for a, b in itertools.pairwise(places))
    for part, (first, last) in zip(used.experiments, places, strict=True):
        for name, values in part.channels.items():
            np.testing.assert_array_equal(values, run.channels[name][first:last])
    assert "Of 80\N{NO-BREAK SPACE}000 samples 20\N{NO-BREAK SPACE}000 were used" in used.sentence
    assert "10 stretches" in used.sentence


def test_every_part_of_the_length_is_drawn_from():
    places = [
        rows(p) for p in excerpt([recording()], ["x"], 10 * LENGTH, length=LENGTH).experiments
    ]
    fifths = {int(first / (BLOCKS * LENGTH / 5)) for first, _ in places}
    assert fifths == set(range(5))


def test_what_happens_once_is_used():
    """One block of forty reaches further than all others, whatever the draw."""
    for seed in range(20):
        run = recording(seed)
        x = run.channels["x"].copy()
        x[31 * LENGTH : 32 * LENGTH] *= 3.0
        once = Experiment("run", 1e-3, {"x": x})
        used = excerpt([once], ["x"], 10 * LENGTH, seed=seed, length=LENGTH)
        assert (31 * LENGTH, 32 * LENGTH) in map(rows, used.experiments)


def test_the_same_seed_draws_the_same_and_another_does_not():
    drawn = [
        [
            rows(p)
            for p in excerpt([recording()], ["x"], 8 * LENGTH, seed=s, length=LENGTH).experiments
        ]
        for s in (3, 3, 4)
    ]
    assert drawn[0] == drawn[1] != drawn[2]


def test_stretches_in_which_nothing_moves_are_left_aside():
    run = recording()
    x, y = (run.channels[name].copy() for name in "xy")
    idle = np.repeat(np.arange(BLOCKS) % 3 > 0, LENGTH)
    x[idle] = 0.0
    y[idle] = 1e-6 * np.sin(np.arange(idle.sum()))
    used = excerpt(
        [Experiment("run", 1e-3, {"x": x, "y": y})], ["x", "y"], 8 * LENGTH, length=LENGTH
    )
    assert len(used.experiments) == 8
    assert all(np.ptp(part.channels["x"]) > 0.5 for part in used.experiments)


def test_a_channel_that_never_moves_leaves_the_others_to_decide():
    x = np.where(np.repeat(np.arange(BLOCKS) % 3 > 0, LENGTH), 0.0, recording().channels["x"])
    run = Experiment("run", 1e-3, {"x": x, "still": np.full(len(x), 2.0)})
    used = excerpt([run], ["x", "still"], 8 * LENGTH, length=LENGTH)
    assert all(np.ptp(part.channels["x"]) > 0.5 for part in used.experiments)


def test_a_recording_without_any_of_the_channels_is_refused():
    with pytest.raises(InputError, match=r"run\.csv: no channel z"):
        excerpt([recording()], ["z"], 8 * LENGTH, length=LENGTH)


def test_a_recording_that_rests_for_the_most_part_is_used_all_the_same():
    x = np.zeros(BLOCKS * LENGTH)
    x[5 * LENGTH : 6 * LENGTH] = np.sin(0.05 * np.arange(LENGTH))
    used = excerpt([Experiment("run", 1e-3, {"x": x})], ["x"], 8 * LENGTH, length=LENGTH)
    assert max(np.ptp(part.channels["x"]) for part in used.experiments) > 1.0


def test_several_recordings_share_by_their_length():
    long, short = recording(), recording(1, "short.csv").part(0, 20 * LENGTH)
    used = excerpt([long, short], ["x"], 12 * LENGTH, length=LENGTH)
    names = [part.name.split(" rows ")[0] for part in used.experiments]
    assert (names.count("run.csv"), names.count("short.csv")) == (8, 4)


def test_fewer_samples_than_make_a_stretch_are_refused():
    with pytest.raises(
        InputError, match=r"samples must be at least 4000 for 2 recordings, 2000 of each, got 3000"
    ):
        excerpt([recording(), recording(1)], ["x"], 3000)
