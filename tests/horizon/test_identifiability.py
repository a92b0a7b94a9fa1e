"""What counts as indistinguishable from the learned map."""

from dataclasses import replace

import pytest

from penode import Start, ladder_plan
from penode.horizon.identifiability import THRESHOLD
from penode.training.loss import Loss
from penode.training.penalties import WeightDecay


def test_parameters_below_the_threshold_are_indistinguishable(systems):
    model = systems["linear machine"].model
    start = Start(model, {"R": 2e-4, "psi": 0.76, "L_d": THRESHOLD, "L_q": 0.99 * THRESHOLD})
    assert start.indistinguishable == ("R", "L_q")


def test_what_was_not_examined_is_not_accused(systems):
    start = Start(systems["linear machine"].model)
    assert start.indistinguishable == ()
    assert start.repair.endswith(".")


def test_a_start_is_frozen(systems):
    with pytest.raises(AttributeError):
        Start(systems["linear machine"].model).repair = ""


def test_a_starts_penalties_join_those_of_the_plan():
    known = WeightDecay(0.1)
    plan = ladder_plan((1, 2))
    plan = replace(plan, loss=Loss(penalties=(WeightDecay(0.2),)))
    joined = Start(None, penalties=(known,)).with_penalties(plan)
    assert joined.loss.penalties == (WeightDecay(0.2), known)
    assert joined.stages == plan.stages
