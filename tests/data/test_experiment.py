"""The Experiment record: copied and frozen at the door, and clear about what it lacks."""

import pickle

import numpy as np
import pytest

from penode.data import Experiment
from penode.data.experiment import Source
from penode.errors import InputError


def test_channels_are_copied_and_read_only() -> None:
    x = np.arange(5.0)
    run = Experiment("run.csv", 0.1, {"x": x})
    x[0] = 9.0
    assert run.channels["x"][0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        run.channels["x"][0] = 1.0
    with pytest.raises(TypeError):
        run.channels["y"] = x  # type: ignore[index]


def test_stack_keeps_the_order_asked_for() -> None:
    run = Experiment("run.csv", 0.1, {"x": np.arange(5), "u": -np.arange(5)})
    np.testing.assert_array_equal(run.stack(["u", "x"]), [[-k, k] for k in range(5)])
    assert len(run) == 5


def test_missing_channel_names_the_present_ones() -> None:
    run = Experiment("run.csv", 0.1, {"x": np.arange(5), "u": np.arange(5)})
    with pytest.raises(InputError, match=r"run\.csv: no channel y, z; it has x, u;"):
        run.stack(["y", "x", "z"])


def test_lengths_must_agree() -> None:
    with pytest.raises(InputError, match=r"run\.csv: channels differ in length .*'x': 5.*'u': 4"):
        Experiment("run.csv", 0.1, {"x": np.arange(5), "u": np.arange(4)})


def test_a_recording_can_be_sent_to_another_process():
    run = Experiment("run.csv", 1e-4, {"x": np.arange(3.0)}, Source("run.csv", "abc"))
    back = pickle.loads(pickle.dumps(run))
    assert (back.name, back.time_step, back.source) == (run.name, run.time_step, run.source)
    np.testing.assert_array_equal(back.channels["x"], run.channels["x"])
    with pytest.raises(ValueError, match="read-only"):
        back.channels["x"][0] = 1.0
