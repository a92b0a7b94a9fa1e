"""Estimates and choices as numbers and their intervals; files."""

import json
import os

import jax
import numpy as np
import pytest
from scipy.stats import norm

from penode.fit.archive import to_json, write_atomically
from penode.fit.model_tree import describe_module, restore_module
from penode.fit.outcome import Contribution, Estimate, HorizonChoice
from penode.pmsm.machine.terms import Resistance


@pytest.mark.parametrize("value", [-3.0, 0.0, 2.5])
def test_the_interval_holds_95_percent_of_a_normal_error(value):
    estimate = Estimate.of(value, 0.4, "A")
    inside = np.diff(norm.cdf(estimate.interval_95, value, 0.4))
    assert inside == pytest.approx(0.95, abs=1e-4)


def test_an_interval_made_otherwise_is_kept_where_nothing_was_assumed():
    """As that of a saved fit, whose ends are their own numbers."""
    rows = (Contribution("statistics", 0.3), Contribution("spread", 0.4))
    one = Estimate(1.0, 0.5, (-7.0, 9.0), "A", budget=rows)
    assert one.statistical_std == pytest.approx(0.5)
    assert one.statistical_interval_95 == (-7.0, 9.0)
    assumed = Estimate(1.0, 1.3, (-7.0, 9.0), "A", budget=(*rows, Contribution("gain", 1.2, "1 %")))
    low, high = assumed.statistical_interval_95
    assert (low, high) == pytest.approx((1 - 0.98, 1 + 0.98))


@pytest.mark.parametrize("verdict", ["implausible", "stopped", "predicts best"])
def test_only_a_refusal_is_no_answer(verdict):
    assert HorizonChoice(1, verdict, "", ()).answered == (verdict != "implausible")


# --- files ------------------------------------------------------------------------------------


def test_numbers_of_any_library_are_plain_json():
    found = json.loads(
        to_json({1: np.int64(3), "b": (np.float32(0.5), [np.inf, -0.0]), "c": True, "d": None})
    )
    assert found == {"1": 3, "b": [0.5, [None, 0.0]], "c": True, "d": None}
    assert isinstance(found["1"], int)


def test_a_file_that_cannot_be_replaced_stays_and_nothing_is_left_beside_it(tmp_path):
    taken = tmp_path / "result.json"
    taken.mkdir()
    (taken / "mine").write_text("kept")
    with pytest.raises(OSError, match=r"result\.json"):
        write_atomically(taken, "new")
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]
    assert (taken / "mine").read_text() == "kept"


def test_others_may_read_what_is_written(tmp_path):
    path = tmp_path / "new" / "result.json"
    write_atomically(path, "ψ = 0")
    assert path.read_bytes().decode("utf-8") == "ψ = 0"
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask


def test_parts_of_one_kind_keep_arrays_of_their_own():
    """Two resistances, whose arrays have one name within their part."""
    model = tuple(Resistance(np.array(value)) for value in (0.05, 0.07))
    arrays = {}
    document = json.loads(json.dumps(describe_module(model, "model", arrays)))
    assert len(arrays) == 2
    again = restore_module(document, arrays)
    for found, leaf in zip(jax.tree.leaves(again), jax.tree.leaves(model), strict=True):
        np.testing.assert_array_equal(found, leaf)
