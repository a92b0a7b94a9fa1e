"""The Experiment record: copied and frozen at the door, and clear about what it lacks."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import penode
import penode.pmsm
from penode.data.experiment import Experiment, Source, require_recordings
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
    with pytest.raises(
        InputError, match=r"run\.csv: channels must have one length, got .*'x': 5.*'u': 4"
    ):
        Experiment("run.csv", 0.1, {"x": np.arange(5), "u": np.arange(4)})


def test_a_recording_can_be_sent_to_another_process():
    run = Experiment("run.csv", 1e-4, {"x": np.arange(3.0)}, Source("run.csv", "abc"))
    back = pickle.loads(pickle.dumps(run))
    assert (back.name, back.time_step, back.source) == (run.name, run.time_step, run.source)
    np.testing.assert_array_equal(back.channels["x"], run.channels["x"])
    with pytest.raises(ValueError, match="read-only"):
        back.channels["x"][0] = 1.0


RUN = Experiment("run.csv", 0.1, {"x": np.arange(5.0)})
NO_RECORDINGS = [
    ("run.csv", "must be recordings, got the path 'run.csv'; load each first"),
    (Path("run.csv"), "as in [penode.load('run.csv')]"),
    (["run.csv"], "experiments must be recordings, got the path 'run.csv'"),
    ([RUN, Path("b.csv")], "experiments must be recordings, got the path 'b.csv'"),
    ([], "experiments must have one recording at least, as in [penode.load(path)]"),
    ((), "experiments must have one recording"),
    (RUN, "experiments must be a list, got one recording, run.csv; put it in brackets"),
    (None, "such as penode.load returns, got NoneType"),
    ({"run": RUN}, "got dict"),
    (
        [RUN, 3.0],
        "experiments must be a list of penode.Experiment, such as penode.load returns, got float",
    ),
]


@pytest.mark.parametrize(("given", "reason"), NO_RECORDINGS)
@pytest.mark.parametrize(
    "identify", [penode.pmsm.identify, lambda given: penode.identify(None, given)]
)
def test_what_is_no_list_of_recordings_is_refused_with_what_to_type(identify, given, reason):
    with pytest.raises(InputError) as caught:
        identify(given)
    assert reason in str(caught.value)


def test_validation_may_be_empty_and_nothing_but_recordings():
    require_recordings([RUN])
    require_recordings((RUN, RUN), (RUN,))
    with pytest.raises(InputError, match=r"validation must be recordings, got the path 'b.csv'"):
        penode.pmsm.identify([RUN], validation="b.csv")


def test_its_text_has_no_samples_in_it():
    run = Experiment("a.csv", 1e-4, {"u": np.zeros(100_000), "x": np.ones(100_000)})
    assert repr(run) == "Experiment a.csv: 100000 samples of 0.0001 s, channels u, x"
