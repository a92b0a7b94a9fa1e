"""Saving: what is written is what load reads back, and a refusal writes nothing."""

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.data.load import load
from penode.data.save import save
from penode.errors import InputError


@pytest.fixture
def run(rng):
    return Experiment("run", 1.25e-4, {"u_d": rng.normal(size=50), "i_d": 1e-9 * np.arange(50)})


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "RUN.CSV"])
def test_a_recording_is_read_back_to_the_last_digit(run, name, tmp_path):
    path = tmp_path / "new" / "folder" / name
    save(run, path)
    again = load(path)
    assert list(again.channels) == ["u_d", "i_d"]
    assert again.time_step == pytest.approx(run.time_step, rel=1e-12)
    for channel, values in run.channels.items():
        np.testing.assert_array_equal(again.channels[channel], values)
    assert [one.name for one in path.parent.iterdir()] == [name]


def test_time_starts_at_zero_and_is_the_first_column(run, tmp_path):
    save(run, tmp_path / "run.csv")
    head, first, second = (tmp_path / "run.csv").read_text().splitlines()[:3]
    assert head == "t,u_d,i_d"
    assert [float(line.split(",")[0]) for line in (first, second)] == [0.0, 1.25e-4]


def test_another_suffix_is_refused_and_nothing_is_made(run, tmp_path):
    with pytest.raises(InputError, match=r"the suffix must be \.csv or \.parquet, got '\.xls'"):
        save(run, tmp_path / "new" / "run.xls")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_replaced_leaves_nothing_beside_it(run, tmp_path):
    (tmp_path / "run.csv").mkdir()
    with pytest.raises(OSError, match=r"run\.csv"):
        save(run, tmp_path / "run.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
