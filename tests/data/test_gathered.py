"""Columns longer than memory are the columns that they would be in it."""

from pathlib import Path

import numpy as np
import pytest

from penode.data import gathered
from penode.data.experiment import Experiment
from penode.data.gathered import Gathered, in_pieces, mapping_of, pieces
from penode.errors import InputError

X = np.random.default_rng(0).normal(size=1000)


@pytest.fixture
def small(monkeypatch):
    """Keep columns of more than 100 samples on disk, and take 64 at a time."""
    monkeypatch.setattr(gathered, "MANY", 100)
    monkeypatch.setattr(gathered, "PIECE", 64)


@pytest.mark.parametrize("count", [0, 1, 99, 100, 101, 1000])
def test_what_is_gathered_is_what_was_added(small, count):
    column = Gathered()
    for first in range(0, count, 37):
        column.add(X[first : min(first + 37, count)])
    assert len(column) == count
    whole = column.whole()
    np.testing.assert_array_equal(whole, X[:count])
    assert (mapping_of(whole) is not None) == (count > 100)


def test_a_column_on_disk_is_read_only_and_so_are_its_parts(small):
    whole = gathered.gathered(X)
    with pytest.raises(ValueError, match="read-only"):
        whole[0] = 1.0
    assert mapping_of(whole[10:20].reshape(2, 5)) is mapping_of(whole)


def test_pieces_and_functions_of_them_are_the_whole(small):
    on_disk = gathered.gathered(X)
    np.testing.assert_array_equal(np.concatenate(list(pieces(on_disk))), X)
    product = in_pieces(lambda a, b: a * b + 1.0, on_disk, X)
    assert mapping_of(product) is not None
    np.testing.assert_array_equal(product, X * X + 1.0)


def test_a_recording_takes_a_column_from_disk_as_it_is(small):
    on_disk = gathered.gathered(X)
    run = Experiment("run", 1e-3, {"x": on_disk, "y": X})
    assert run.channels["x"] is on_disk
    assert not np.shares_memory(run.channels["y"], X)
    again = Experiment("again", 1e-3, run.channels)
    assert again.channels["y"] is run.channels["y"]


def test_what_can_still_be_written_to_is_copied():
    own = np.arange(8.0)
    view = own[:]
    view.setflags(write=False)
    run = Experiment("run", 1e-3, {"x": view})
    own[0] = 9.0
    assert run.channels["x"][0] == 0.0


def test_a_part_names_its_data_rows_and_lies_in_memory(small):
    run = Experiment("run.csv", 1e-3, {"x": gathered.gathered(X)})
    part = run.part(100, 150)
    assert part.name == "run.csv rows 101 to 150"
    assert mapping_of(part.channels["x"]) is None
    np.testing.assert_array_equal(part.channels["x"], X[100:150])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device here")
def test_a_full_disk_is_one_sentence(small, monkeypatch):
    full = Path("/dev/full").open
    monkeypatch.setattr(gathered.tempfile, "TemporaryFile", lambda **_: full("wb"))
    with pytest.raises(InputError, match=r"temporary files cannot take .*set TMPDIR"):
        gathered.gathered(X)
