"""How long a training still takes, by a clock that the test turns."""

import pytest

from penode.cli.time_left import TimeLeft, in_words


class Training:
    """A training of some horizons whose evaluations take a given time."""

    def __init__(self, stages, pace=1.0):
        self.now, self.stages, self.pace = 100.0, stages, pace
        self.left = TimeLeft(lambda: self.now)

    def evaluate(self, stage, count):
        """Evaluate, told after each evaluation, and return the estimates."""
        estimates = []
        for _ in range(count):
            self.now += self.pace
            self.left({"event": "evaluation", "stage": stage, "stages": self.stages})
            estimates.append(self.left.seconds)
        return estimates

    def finish(self, stage, count):
        self.left({"event": "rung", "stage": stage, "stages": self.stages, "evaluations": count})
        return self.left.seconds


def test_nothing_is_known_before_the_second_horizon_is_done():
    """The first starts cold: its many evaluations tell nothing about the others."""
    training = Training(4)
    assert training.left.seconds is None
    assert training.evaluate(1, 40) == [None] * 40
    assert training.finish(1, 40) is None
    assert training.evaluate(2, 5) == [None] * 5
    assert training.finish(2, 5) == 10.0


@pytest.mark.parametrize("pace", [0.1, 3.0])
def test_equal_horizons_are_counted_down_to_zero(pace):
    training = Training(5, pace)
    for stage in (1, 2):
        training.evaluate(stage, 6)
        training.finish(stage, 6)
    for stage in (3, 4, 5):
        ahead = 6 * (5 - stage)
        expected = [pace * (ahead + here) for here in (5, 4, 3, 2, 1)]
        assert training.evaluate(stage, 5) == pytest.approx(expected)
        training.evaluate(stage, 1)
        assert training.finish(stage, 6) == pytest.approx(pace * ahead)
    assert training.left.seconds == 0.0


def test_a_horizon_longer_than_those_before_it_is_never_overdue():
    training = Training(3)
    for stage in (1, 2):
        training.evaluate(stage, 4)
        training.finish(stage, 4)
    assert min(training.evaluate(3, 20)) == 1.0


def test_rungs_taken_over_tell_the_effort_but_not_the_pace():
    training = Training(4, pace=2.0)
    for stage, count in ((1, 30), (2, 6), (3, 10)):
        assert training.finish(stage, count) is None
    first, second = training.evaluate(4, 2)
    assert first is None
    assert second == pytest.approx((8 - 2) * 2.0)


def test_what_lies_between_horizons_is_not_taken_for_an_evaluation():
    training = Training(3)
    for stage in (1, 2):
        training.evaluate(stage, 3)
        training.finish(stage, 3)
        training.now += 60.0  # such as compiling
    (left,) = training.evaluate(3, 1)
    assert left == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.0, "a few seconds"),
        (7.4, "a few seconds"),
        (8.0, "about 10 s"),
        (23.0, "about 25 s"),
        (57.0, "about 55 s"),
        (58.0, "about 1 min"),
        (200.0, "about 3 min"),
        (3500.0, "about 1 h"),
        (9000.0, "about 2.5 h"),
        (40000.0, "about 11 h"),
    ],
)
def test_a_duration_is_told_as_coarse_as_it_is_known(seconds, words):
    assert in_words(seconds) == words
