"""Prediction errors in words, against errors written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from penode.report.statements import (
    free_run_value,
    one_step_text,
    one_step_value,
    relative_error,
)
from penode.validation.comparison import Comparison

GAP = "\N{NO-BREAK SPACE}"
SAMPLES = 50


def compared(free, step, units, size=(30.0, 40.0)):
    """Return a comparison whose states are constant and whose errors are those given."""
    measured = np.tile(np.array(size), (SAMPLES, 1))
    one_step, free_run = measured + np.array(step), measured - np.array(free)
    names = ("a", "b")
    return Comparison("run.csv", "train", 1e-3, names, units, measured, one_step, free_run)


def test_states_of_one_unit_are_judged_by_the_length_of_their_vector():
    """The error is the mean over states, 5 A in each; the largest vector is 50 A long."""
    one = compared((5.0, 5.0), (0.0, 0.0), ("A", "A"))
    assert relative_error(one) == pytest.approx(5.0 / 50.0)
    assert free_run_value([one]).detail.startswith(f"10{GAP}% of the largest value; recording used")


def test_states_of_two_units_are_judged_by_the_worst():
    one = compared((3.0, 8.0), (0.0, 0.0), ("A", "V"))
    assert relative_error(one) == pytest.approx(max(3 / 30, 8 / 40))
    assert free_run_value([one]).value is None


@pytest.mark.parametrize("units", [("A", "A"), ("A", "V")])
def test_a_state_that_never_leaves_zero_divides_nothing(units):
    one = compared((0.5, 0.5), (0.0, 0.0), units, size=(0.0, 0.0))
    assert relative_error(one) == pytest.approx(0.5)


def test_the_worst_recording_is_worst_beside_what_it_moves():
    """5 A of 50 A is worse than 6 A of 500 A."""
    small = compared((5.0, 5.0), (0.0, 0.0), ("A", "A"))
    large = compared((6.0, 6.0), (0.0, 0.0), ("A", "A"), size=(300.0, 400.0))
    shown = free_run_value([large, small])
    assert shown.text == f"5.00{GAP}A"
    assert shown.detail.endswith("worst of 2 recordings used for training")
    assert not shown.doubtful


def test_a_diverged_recording_is_worst_of_all_and_named():
    fine = compared((5.0, 5.0), (0.0, 0.0), ("A", "A"))
    lost = replace(fine, name="lost.csv", free_run=np.full((SAMPLES, 2), np.nan))
    shown = free_run_value([fine, lost])
    assert (shown.text, shown.doubtful) == ("diverged", True)
    assert shown.detail == "lost.csv, worst of 2 recordings used for training"


@pytest.mark.parametrize(
    ("units", "text"),
    [
        (("A", "A"), f"4.00{GAP}A"),  # the largest
        (("A", "V"), f"a{GAP}3.00{GAP}A, b{GAP}3.00{GAP}V"),  # the largest beside its values
    ],
)
def test_the_largest_one_step_error_is_that_of_the_worst_recording(units, text):
    small = compared((0.0, 0.0), (3.0, 3.0), units)
    large = compared((0.0, 0.0), (4.0, 4.0), units, size=(300.0, 400.0))
    assert one_step_value([small, large]).text == text


def test_a_state_that_is_not_predicted_leaves_a_dash():
    one = compared((1.0, 1.0), (np.nan, 0.5), ("A", "V"))
    assert one_step_text(one) == "–"
    whole = compared((1.0, 1.0), (0.5, 0.5), ("A", "V"))
    assert one_step_value([one, whole]).text == one_step_text(whole)


def test_a_quantity_without_unit_is_a_bare_number():
    assert one_step_text(compared((0.0, 0.0), (0.5, 0.5), ("", ""))) == "0.500"
