"""The fuzzer reads every good file, and notices what is neither columns nor a refusal."""

import time

import numpy as np
import pytest
from fuzz.damage import damaged
from fuzz.readers import run
from fuzz.seeds import SEEDS

from penode.data.readers import csv
from penode.errors import InputError


def raises(error):
    def read(file, content):
        raise error

    return read


def test_damaged_text_is_read_or_refused(tmp_path):
    tally = run(0.5, 1, tmp_path, ["csv"])["csv"]
    assert tally.outcomes["refused"] > tally.outcomes["read"] > 0
    assert tally.findings == []


@pytest.mark.parametrize(
    "error", [KeyError("x"), InputError("no file is named."), InputError("case without an end")]
)
def test_what_is_no_refusal_is_kept_with_its_file(tmp_path, monkeypatch, error):
    monkeypatch.setattr(csv, "read", raises(error))
    tally = run(0.05, 1, tmp_path, ["csv"])["csv"]
    assert tally.outcomes.keys() == {"neither"}
    assert len(tally.findings) == len(list(tmp_path.iterdir())) > 0


def test_what_takes_too_long_is_kept(tmp_path, monkeypatch):
    def slow(file, content):
        end = time.process_time() + 0.03
        while time.process_time() < end:
            pass
        raise InputError("case is refused.")

    monkeypatch.setattr(csv, "read", slow)
    monkeypatch.setattr("fuzz.readers.SLOWEST", 0.01)
    monkeypatch.setattr("fuzz.readers._AT_ONCE", 1)
    tally = run(0.01, 1, tmp_path, ["csv"])["csv"]
    assert "it took 0.0" in tally.findings[0]


@pytest.mark.parametrize("name", SEEDS)
def test_damage_is_drawn_from_the_seed(name):
    seeds = SEEDS[name]()
    draws = [np.random.default_rng(3), np.random.default_rng(3)]
    first, again = ([damaged(rng, seeds) for _ in range(10)] for rng in draws)
    assert first == again
    assert not set(first) <= set(seeds)
