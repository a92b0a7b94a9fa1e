"""What counts as indistinguishable from the learned map."""

import pytest

from penode import Start
from penode.horizon.identifiability import THRESHOLD


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
