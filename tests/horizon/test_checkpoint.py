"""A climb that was stopped and resumed is the climb that was not."""

import json
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from penode import Contiguous, InputError, Plan, Stage, identify, ladder_plan
from penode.fit.archive import sha256, to_json
from penode.fit.outcome import Contribution
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.identify import Stopped
from penode.models.networks import TanhLayers
from penode.training.covariance import Reported
from penode.training.plan import DIVERGED, Solution
from penode.training.second_order import LevenbergMarquardt

HORIZONS = (1, 3, 7, 12)


@dataclass
class Person:
    """Watches; presses Ctrl-C at the first event of a kind at the stage-th horizon, if told to."""

    kind: str = ""
    stage: int = 0
    events: list = field(default_factory=list)

    def __call__(self, event):
        self.events.append(event)
        if (event["event"], event.get("stage")) == (self.kind, self.stage):
            raise KeyboardInterrupt

    def horizons(self, kind):
        return [e["horizon"] for e in self.events if e["event"] == kind]


class Climb:
    """The linear machine on a noisy recording, from a start that is off."""

    def __init__(self, system, objective):
        self.objective, self.model = objective, system.model
        self.runs = system.recorded_again(noise=0.05)
        self.raw = system.raw + 0.1
        self.plan = ladder_plan(HORIZONS)

    def __call__(self, observer=ignore_events, checkpoint=None, **given):
        return self.climbed(observer, checkpoint, **given).fits

    def climbed(self, observer=ignore_events, checkpoint=None, **given):
        plan = given.get("plan", self.plan)
        if checkpoint is not None:
            plan = checkpoint.over(plan, observer)
        reported = Reported(self.objective.layout, np.zeros((1, 2)))
        runs = given.get("runs", self.runs)
        problem = LadderProblem(self.objective, reported, self.model, runs, observer)
        return problem.climb(plan, given.get("raw", self.raw))


@pytest.fixture(scope="module")
def climb(systems, objective_of):
    system = systems["linear machine"]
    return Climb(system, objective_of(system))


@pytest.fixture(scope="module")
def unbroken(climb):
    return climb()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "fit" / "checkpoint.json"


@pytest.fixture
def stopped(climb, path):
    """Return the file of a climb that was stopped at its third horizon."""
    assert climb.climbed(Person("evaluation", 3), Checkpoint(path)).interrupted
    return path


def assert_equal(rungs, others):
    assert [rung.horizon for rung in rungs] == [rung.horizon for rung in others]
    for a, b in zip(rungs, others, strict=True):
        for name in ("values", "deviation", "influence"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        for name in ("raw", "evaluations", "outcome"):
            np.testing.assert_array_equal(getattr(a.solution, name), getattr(b.solution, name))
        assert a.solution.terms.loss == b.solution.terms.loss


# --- going on ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "stage"), [("rung", 1), ("evaluation", 2), ("rung", 2), ("evaluation", 4), ("rung", 4)]
)
def test_a_resumed_climb_ends_where_the_unbroken_one_does(climb, unbroken, path, kind, stage):
    stopped = climb.climbed(Person(kind, stage), Checkpoint(path))
    assert stopped.interrupted
    kept = stage - 1 if kind == "evaluation" else stage
    assert_equal(stopped.fits, unbroken[:kept])
    watcher = Person()
    assert_equal(climb(watcher, Checkpoint(path, resume=True)), unbroken)
    assert watcher.events[0] == {"event": "resume", "horizons": list(HORIZONS[:kept])}
    assert set(watcher.horizons("evaluation")) == set(HORIZONS[kept:]), "kept rungs are not redone"
    assert watcher.horizons("rung") == list(HORIZONS), "kept rungs are told"


def test_a_climb_stopped_twice_ends_where_the_unbroken_one_does(climb, unbroken, stopped):
    again = climb.climbed(Person("evaluation", 4), Checkpoint(stopped, resume=True))
    assert again.interrupted
    assert_equal(climb(checkpoint=Checkpoint(stopped, resume=True)), unbroken)


def test_a_finished_climb_is_taken_over_whole(climb, unbroken, path):
    climb(checkpoint=Checkpoint(path))
    watcher = Person()
    assert_equal(climb(watcher, Checkpoint(path, resume=True)), unbroken)
    assert watcher.horizons("evaluation") == []


def test_without_a_file_a_resumed_climb_begins_at_its_start(climb, unbroken, path):
    assert_equal(climb(checkpoint=Checkpoint(path, resume=True)), unbroken)


def test_a_kill_leaves_what_a_stop_leaves(climb, stopped, path, tmp_path):
    """Every rung is on disk before it is told, and nothing is written at the end."""
    seen, copy = [], tmp_path / "killed.json"

    def watcher(event):
        if event["event"] == "rung":
            seen.append(copy.read_text())

    climb(watcher, Checkpoint(copy))
    assert [len(json.loads(text)["rungs"]) for text in seen] == [1, 2, 3, 4]
    assert seen[1] == path.read_text()


# --- not going on -----------------------------------------------------------------------------


def test_ctrl_c_before_the_first_rung_leaves_no_file_and_an_earlier_one_alone(climb, path):
    with pytest.raises(KeyboardInterrupt):
        climb(Person("evaluation", 1), Checkpoint(path))
    assert not path.exists()
    climb(checkpoint=Checkpoint(path), plan=ladder_plan((1, 2)))
    before = path.read_bytes()
    with pytest.raises(KeyboardInterrupt):
        climb(Person("evaluation", 1), Checkpoint(path))
    assert path.read_bytes() == before


def test_a_new_climb_replaces_the_file_of_an_earlier_one(climb, unbroken, stopped):
    watcher = Person()
    assert_equal(climb(watcher, Checkpoint(stopped)), unbroken)
    assert set(watcher.horizons("evaluation")) == set(HORIZONS)
    assert len(json.loads(stopped.read_text())["rungs"]) == len(HORIZONS)


class Diverging:
    def minimise(self, problem, raw, progress):
        return Solution(raw, problem.gauss_newton(raw), 1, DIVERGED)


def test_a_diverged_rung_is_not_kept(climb, path):
    plan = Plan((Stage(1, LevenbergMarquardt()), Stage(3, Diverging())))
    assert [rung.horizon for rung in climb(checkpoint=Checkpoint(path), plan=plan)] == [1]
    assert [rung["horizon"] for rung in json.loads(path.read_text())["rungs"]] == [1]


# --- refusals ---------------------------------------------------------------------------------


def others(climb):
    """What may be other than in the stopped climb -> what came, and what the refusal says."""
    first = climb.runs[0]
    moved = replace(first, channels={**first.channels, "u_d": first.channels["u_d"] + 1e-9})
    quick = LevenbergMarquardt(evaluations=9)
    return {
        "recording": ({"runs": (moved, *climb.runs[1:])}, "its recordings;"),
        "fewer recordings": ({"runs": climb.runs[:1]}, "its recordings;"),
        "horizons": (
            {"plan": ladder_plan((1, 3, 7))},
            r"its horizons \(1, 3, 7, 12 there, 1, 3, 7 here\);",
        ),
        "optimiser": ({"plan": ladder_plan(HORIZONS, quick)}, "its optimisers;"),
        "seed": ({"plan": ladder_plan(HORIZONS, seed=1)}, r"its window placement \(Jittered"),
        "placement": ({"plan": Plan(climb.plan.stages, Contiguous())}, "its window placement"),
        "start": ({"raw": climb.raw + 1e-3}, "its start;"),
    }


@pytest.mark.parametrize(
    "what",
    ["recording", "fewer recordings", "horizons", "optimiser", "seed", "placement", "start"],
)
def test_a_file_of_another_climb_is_refused_by_name(climb, stopped, what):
    given, words = others(climb)[what]
    before = stopped.read_bytes()
    with pytest.raises(InputError, match=words) as refusal:
        climb(checkpoint=Checkpoint(stopped, resume=True), **given)
    assert str(refusal.value).startswith(f"{stopped}: the stopped fit differs in its")
    assert stopped.read_bytes() == before


def test_a_start_that_another_processor_rounded_is_the_same(climb, unbroken, stopped):
    rungs = climb(checkpoint=Checkpoint(stopped, resume=True), raw=climb.raw * (1 + 1e-12))
    assert_equal(rungs, unbroken)


# --- what a climb began with --------------------------------------------------------------------

ASKED = {"purpose": "parameters", "seed": 0}
BEGAN = (Contribution("gain", np.inf), {"anchor": (0.1, -np.inf)}, np.array([0.1, np.nan]))


@pytest.fixture
def begun(climb, path):
    """Return the file of a stopped climb that keeps what it began with."""
    checkpoint, watcher = Checkpoint(path), Person("evaluation", 2)
    plan = checkpoint.over(climb.plan, watcher, ASKED, BEGAN)
    assert climb.climbed(watcher, plan=plan).interrupted
    return path


def test_what_a_climb_began_with_is_returned_to_the_last_digit(begun):
    record, anchor, values = Checkpoint(begun, resume=True).begun(ASKED)
    assert (record, anchor) == BEGAN[:2]
    np.testing.assert_array_equal(values, BEGAN[2])


def test_nothing_is_returned_where_nothing_is_resumed(begun, tmp_path):
    assert Checkpoint(begun).begun(ASKED) is None
    assert Checkpoint(tmp_path / "none.json", resume=True).begun(ASKED) is None


def test_something_else_asked_for_is_refused_by_name(begun):
    with pytest.raises(InputError, match=r"its purpose \('parameters' there, 'simulation' here\)"):
        Checkpoint(begun, resume=True).begun({**ASKED, "purpose": "simulation"})


def test_the_start_of_a_climb_that_keeps_it_is_no_difference(climb, unbroken, begun):
    """Another run rounds otherwise, and some directions of a start are hardly determined."""
    plan = Checkpoint(begun, resume=True).over(climb.plan, ignore_events, ASKED)
    assert_equal(climb(plan=plan, raw=climb.raw + 1e-3), unbroken)


def test_a_file_of_the_earlier_schema_is_read(climb, unbroken, stopped):
    document = json.loads(stopped.read_text())
    for name in ("sha256", "began", "asked"):
        del document[name]
    document["schema"] = "penode-checkpoint/1"
    document["sha256"] = sha256(to_json(document).encode())
    stopped.write_text(to_json(document))
    checkpoint = Checkpoint(stopped, resume=True)
    assert checkpoint.begun(ASKED) is None
    assert_equal(climb(checkpoint=checkpoint), unbroken)


def test_a_damaged_file_is_refused_by_name(climb, stopped):
    text = stopped.read_text()
    document = json.loads(text)
    digit = repr(document["rungs"][0]["raw"][0])
    damaged = {
        "cut short": text[: len(text) // 2],
        "one number changed": text.replace(digit, repr(document["rungs"][0]["raw"][0] + 1e-9)),
        "no checkpoint": "{}",
        "a list": "[]",
        "not text": "\x00\x01",
    }
    for case, content in damaged.items():
        assert content != text, case
        stopped.write_text(content)
        with pytest.raises(InputError, match="the checkpoint cannot be read") as refusal:
            climb(checkpoint=Checkpoint(stopped, resume=True))
        assert str(stopped) in str(refusal.value), case


def test_a_folder_that_cannot_be_written_is_told(climb, tmp_path):
    (tmp_path / "fit").write_text("a file where the folder should be")
    with pytest.raises(InputError, match=r"checkpoint\.json: the checkpoint cannot be written"):
        climb(checkpoint=Checkpoint(tmp_path / "fit" / "checkpoint.json"))


# --- the main path ----------------------------------------------------------------------------


def test_a_stopped_identification_carries_the_best_so_far(oscillator, systems, path):
    spring = TanhLayers.random((1, 3, 1), seed=1)
    start = replace(systems["duffing"].model, spring=spring, mass=1.0, damping=0.1)
    plan, person = ladder_plan((1, 2, 4, 8, 16)), Person("evaluation", 4)
    with pytest.raises(Stopped) as stop:
        identify(
            start,
            [oscillator.recording],
            plan=Checkpoint(path).over(plan, person),
            observer=person,
        )
    fit = stop.value.fit
    assert person.events[-1] == {"event": "stop", "horizon": 4}
    assert fit.horizon.verdict == "stopped"
    assert fit.horizon.answered
    assert fit.horizon.reason.startswith("The ladder was not climbed to its end. So far: ")
    assert fit.warnings == ("Stopped after horizon 4 of 16; longer ones were not tried.",)
    assert fit.horizon.ladder == oscillator.fit.horizon.ladder[:3]
    assert abs(fit.parameters["mass"].value / 0.7 - 1) < 0.1
    again = identify(
        start,
        [oscillator.recording],
        plan=Checkpoint(path, resume=True).over(plan, ignore_events),
    )
    assert again.horizon == oscillator.fit.horizon
    assert again.parameters == oscillator.fit.parameters
    np.testing.assert_array_equal(again.excited, oscillator.fit.excited)
