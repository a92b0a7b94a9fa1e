"""A check that fails is left out by name; the fit, and what the other checks object to, stand."""

import sys

import numpy as np
import pytest

from penode import Experiment, identify, ladder_plan
from penode.fit.outcome import Objection
from penode.horizon.identifiability import Start
from penode.horizon.objections import guarded

OBJECTION = Objection("odd", "It is odd.", "Repair it.")


@pytest.fixture(autouse=True)
def details(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def slow_poles(_fit, _experiments):
    yield OBJECTION
    raise np.linalg.LinAlgError("Singular matrix")


def sound(_fit, _experiments):
    yield OBJECTION


@pytest.fixture
def recorded(systems):
    system = systems["linear machine"]
    return system.model, [system.experiments[0]]


@pytest.mark.parametrize("checks", [(slow_poles,), (slow_poles, sound)])
def test_a_check_that_fails_is_a_warning_and_the_fit_stands(recorded, checks, caplog):
    model, runs = recorded
    fit = identify(Start(model, checks=checks), runs, plan=ladder_plan((1,)))
    without = identify(Start(model, checks=(sound,) * len(checks)), runs, plan=ladder_plan((1,)))
    assert fit.horizon == without.horizon, "what it had found before it failed is kept"
    (sentence,) = set(fit.warnings) - set(without.warnings)
    assert sentence.startswith(
        "The check for slow poles could not be made (LinAlgError: Singular matrix); please send in"
    )
    assert [record.getMessage() for record in caplog.records] == [sentence]


def test_a_failure_of_the_training_itself_is_not_hidden(recorded, monkeypatch):
    monkeypatch.setattr(sys.modules["penode.horizon.search"], "choose", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        identify(recorded[0], recorded[1], plan=ladder_plan((1,)))


def test_a_check_of_any_kind_of_callable_has_a_name(caplog):
    class Nameless:
        def __call__(self, fit, experiments):
            return iter([1 / 0 for _ in range(1)])

    missed = []
    run = Experiment("run.csv", 1.0, {"x": np.zeros(3)})
    assert list(guarded(Nameless(), missed)(None, [run])) == []
    assert missed[0].startswith("The check for a convention could not be made (ZeroDivisionError")
