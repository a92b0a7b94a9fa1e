"""The log and the table: what is in them, and what is left of them after an interruption."""

import io
import json
import math

import pytest
from rich.console import Console

from penode.cli.console import Interrupted
from penode.cli.progress import LadderView, watched
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.horizon.checkpoint import Checkpoint

EARLIER = '{"elapsed_s": 0.1, "event": "start"}\n'


def evaluation(stage, loss=4.0):
    return {
        "event": "evaluation",
        "horizon": 3 * stage,
        "stage": stage,
        "stages": 4,
        "loss": loss,
        "parameters": {"R": 0.0123},
        "units": {"R": "ohm"},
    }


def rung(stage):
    event = {
        **evaluation(stage),
        "event": "rung",
        "rmse": 2.0,
        "rmse_unit": "A",
        "std": {"R": 1e-4},
    }
    return {**event, "evaluations": 5, "outcome": "Done."}


def quiet():
    return Console(file=io.StringIO())


def logged(folder):
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    return [(event["event"], event.get("horizon")) for event in events]


def work(folder, events, error=None, checkpoint=None):
    with watched(folder, quiet(), checkpoint) as observer:
        for event in events:
            if checkpoint is not None and event["event"] == "rung":
                write_atomically(checkpoint.path, "as it would be")
            observer(event)
        if error is not None:
            raise error


@pytest.fixture
def checkpoint(tmp_path):
    return Checkpoint(tmp_path / "out" / "fit" / "checkpoint.json")


@pytest.fixture
def resumed(checkpoint):
    return Checkpoint(checkpoint.path, resume=True)


# --- the log ----------------------------------------------------------------------------------


def test_every_event_is_a_line_at_once(tmp_path):
    with watched(tmp_path / "out", quiet()):
        pass
    assert not (tmp_path / "out").exists(), "nothing happened, nothing is left"
    with watched(tmp_path / "out", quiet()) as observer:
        observer(evaluation(1))
        assert logged(tmp_path / "out") == [("evaluation", 3)]
        observer(rung(1))
    lines = (tmp_path / "out" / "events.jsonl").read_text().splitlines()
    assert all(json.loads(line)["elapsed_s"] >= 0 for line in lines)
    assert json.loads(lines[1])["std"] == {"R": 1e-4}


def test_a_training_replaces_the_log_of_before_and_a_resumed_one_goes_on(
    tmp_path, checkpoint, resumed
):
    out = tmp_path / "out"
    work(out, [evaluation(4)], checkpoint=checkpoint)
    work(out, [evaluation(1), rung(1), evaluation(2)], checkpoint=checkpoint)
    resume = {"event": "resume", "horizons": [3]}
    work(out, [resume, rung(1), evaluation(2), rung(2)], checkpoint=resumed)
    assert logged(out) == [
        ("evaluation", 3),
        ("rung", 3),
        ("evaluation", 6),
        ("resume", None),
        ("evaluation", 6),
        ("rung", 6),
    ], "the rung taken over is told once"


def test_a_rung_taken_over_that_the_log_lacks_is_told(tmp_path, checkpoint, resumed):
    """Killed between the checkpoint and the log, or the log of before was lost."""
    out = tmp_path / "out"
    work(out, [rung(1)], checkpoint=checkpoint)
    work(out, [{"event": "resume", "horizons": [3, 6]}, rung(1), rung(2)], checkpoint=resumed)
    assert logged(out) == [("rung", 3), ("resume", None), ("rung", 6)]


def test_a_rung_climbed_again_is_told_again(tmp_path, checkpoint, resumed):
    out = tmp_path / "out"
    work(out, [rung(1), rung(2)], checkpoint=checkpoint)
    work(out, [{"event": "resume", "horizons": [3]}, rung(1), rung(2)], checkpoint=resumed)
    assert logged(out) == [("rung", 3), ("rung", 6), ("resume", None), ("rung", 6)]


# --- what an interruption leaves --------------------------------------------------------------


@pytest.mark.parametrize("error", [KeyboardInterrupt(), InputError("x"), ZeroDivisionError()])
@pytest.mark.parametrize("resume", [False, True])
def test_the_log_is_restored_when_nothing_is_kept(tmp_path, checkpoint, error, resume):
    """A refused resume too: its checkpoint is of other data."""
    out = tmp_path / "out"
    events = [{"event": "resume", "horizons": [3]}, evaluation(2)]
    expected = Interrupted if isinstance(error, KeyboardInterrupt) else type(error)
    again = Checkpoint(checkpoint.path, resume)
    with pytest.raises(expected):
        work(out, events, error, again)
    assert not out.exists()
    out.mkdir()
    (out / "events.jsonl").write_text(EARLIER)
    with pytest.raises(expected):
        work(out, events, error, again)
    assert (out / "events.jsonl").read_text() == EARLIER
    assert [path.name for path in out.iterdir()] == ["events.jsonl"]


def test_the_log_stays_when_a_rung_is_kept(tmp_path, checkpoint):
    out = tmp_path / "out"
    out.mkdir()
    (out / "events.jsonl").write_text(EARLIER)
    with pytest.raises(ZeroDivisionError):
        work(out, [rung(1), evaluation(2)], ZeroDivisionError(), checkpoint)
    assert logged(out) == [("rung", 3), ("evaluation", 6)]


def test_the_sentence_says_what_remains(tmp_path, checkpoint, resumed):
    nothing = r"^Stopped; no result was written\.$"
    something = r"^Stopped; the finished horizons are kept: add --resume to go on\.$"
    cases = [
        (nothing, [evaluation(1)], checkpoint),
        (nothing, [rung(1)], None),
        (something, [rung(1), evaluation(2)], checkpoint),
        (something, [evaluation(2)], resumed),
    ]
    for sentence, events, kept in cases:
        with pytest.raises(Interrupted, match=sentence):
            work(tmp_path / "out", events, KeyboardInterrupt(), kept)


# --- the table --------------------------------------------------------------------------------


def printed(thing):
    console = Console(file=io.StringIO(), width=100, color_system=None)
    console.print(thing)
    return console.file.getvalue()


def words(picture, mark):
    return next(line for line in picture.splitlines() if mark in line).split()


def test_the_table_shows_resistance_rmse_horizon_and_the_time_left():
    view, pictures = LadderView(quiet()), []
    for event in (
        {"event": "start", "recordings": ["run.csv"]},
        evaluation(1),
        rung(1),
        evaluation(2),
        evaluation(2),
        rung(2),
        evaluation(3),
        {"event": "stop", "horizon": 6},
    ):
        view(event)
        pictures.append(printed(view.picture()))
    assert "Finding a start" in pictures[0]
    assert words(pictures[1], "R =") == ["3", "R", "=", "12.30", "mΩ", "2.000"]
    assert words(pictures[2], "R =") == [
        "3",
        "R",
        "=",
        "12.30",
        "±",
        "0.10",
        "mΩ",
        "2.000",
        "A",
        "5",
    ]
    assert pictures[4].splitlines()[-1].strip() == "rung 2 of 4 -:--:--", "nothing to go by"
    assert pictures[6].splitlines()[-1].strip().startswith("rung 3 of 4 0:00:0")
    assert pictures[7].count("R =") == 2, "a horizon that was not finished counts for nothing"
    assert "Stopping after horizon 6" in pictures[7]
    assert "Ctrl-C again leaves at once" in pictures[7]


@pytest.mark.parametrize("terminal", [True, False])
def test_finished_rungs_stay_on_a_terminal_and_are_a_line_each_in_a_pipe(terminal):
    console = Console(file=io.StringIO(), width=100, color_system=None, force_terminal=terminal)
    with LadderView(console) as view:
        for event in (evaluation(1), rung(1), evaluation(2)):
            view(event)
    said = console.file.getvalue()
    if terminal:
        last = said.rpartition("horizon")[2]
        found = words(last, "R =")
        assert found == ["3", "R", "=", "12.30", "±", "0.10", "mΩ", "2.000", "A", "5"]
        assert last.count("R =") == 1
    else:
        assert said == "rung 1 of 4: H = 3, R = 12.30 ± 0.10 mΩ (std), RMSE over H steps 2.000 A\n"


def test_a_deviation_that_is_not_known_is_said():
    console = Console(file=io.StringIO(), width=100)
    with LadderView(console) as view:
        view({**rung(1), "std": {"R": math.inf}})
    said = "rung 1 of 4: H = 3, R = 12.30 ± unknown mΩ (std), RMSE over H steps 2.000 A\n"
    assert console.file.getvalue() == said


def test_the_line_says_what_goes_on_before_and_after_the_ladder():
    view = LadderView(quiet())
    view({"event": "resume", "horizons": []})
    assert printed(view.picture()).strip() == ""
    view({"event": "resume", "horizons": [3, 6]})
    assert "Going on after horizon 6 ..." in printed(view.picture())
    for stage in (3, 4):
        view(rung(stage))
        said = "All horizons done: predicting the recordings ..." in printed(view.picture())
        assert said == (stage == 4)


def test_an_event_between_evaluations_leaves_the_line_as_it_was():
    view = LadderView(quiet())
    view(evaluation(2))
    view({"event": "note"})
    last = printed(view.picture()).splitlines()[-1]
    assert last.strip() == "rung 2 of 4 -:--:--"
    assert "R =" not in printed(view.picture()), "what is not finished is not shown as if it were"
