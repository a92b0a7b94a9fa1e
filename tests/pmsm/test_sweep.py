"""Sweeps: what is kept, what is done anew, and what becomes of failures."""

import csv
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from penode import InputError
from penode.pmsm import sweep as module
from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import simulate
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study
from penode.pmsm.sweep import grid_of, sweep, write_sweep

PLAIN = Study(candidates=(), angle_orders=())


@pytest.fixture(scope="module")
def run():
    return simulate(TRACTION_300A, Lissajous(200.0, 140.0, 150.0), speed_rpm=150.0, duration=0.2)


@pytest.fixture(scope="module")
def fit(run):
    return identify([run], study=replace(PLAIN, horizon=2, seed=1))


@pytest.fixture
def asked(monkeypatch, fit):
    """Replace training, which has tests of its own; return the studies that were asked for."""
    studies = []

    def known(experiments, *, study):
        studies.append(study)
        if study.seed == 2:
            raise InputError("run.csv: it diverges.")
        return fit

    monkeypatch.setattr(module, "identify", known)
    return studies


def swept(runs, study, grid, folder, resume=False):
    with ThreadPoolExecutor(1) as executor:
        return list(sweep(runs, study, grid, folder, executor, resume))


def test_each_is_the_identification_at_that_horizon_from_that_seed(run, fit, asked, tmp_path):
    (found,) = swept([run], PLAIN, [(2, 1)], tmp_path)
    assert asked == [replace(PLAIN, horizon=2, seed=1)]
    assert (found.horizon, found.seed, found.failure) == (2, 1, "")
    assert found.parameters == {"R": fit.horizon.ladder[-1].parameters["R"]}
    assert found.std == {"R": fit.horizon.ladder[-1].std["R"]}
    assert found.units == {"R": "ohm"}
    assert found.rmse == fit.horizon.ladder[-1].rmse
    assert (tmp_path / "seed1" / "H2" / "fit" / "fit.json").exists()


def test_what_is_left_to_the_data_is_decided_once(run, asked, tmp_path):
    swept([run], Study(), grid_of((1, 2), 2), tmp_path)
    assert [(s.horizon, s.seed) for s in asked] == [(1, 0), (1, 1), (2, 0), (2, 1)]
    assert {(s.terms, s.candidates, s.angle_orders) for s in asked} == {((), (), ())}


def test_only_what_was_made_in_the_same_way_is_kept(run, asked, tmp_path):
    grid = [(1, 0), (2, 0)]
    first = swept([run], PLAIN, grid, tmp_path)
    again = swept([run], PLAIN, [*grid, (3, 0)], tmp_path, resume=True)
    assert [s.horizon for s in asked] == [1, 2, 3]
    assert again[:2] == first
    swept([run], replace(PLAIN, flux_map="mlp"), grid, tmp_path, resume=True)
    assert len(asked) == 5
    channels = dict(run.channels) | {"u_d": run.channels["u_d"] + 1e-9}
    swept([replace(run, channels=channels)], PLAIN, grid, tmp_path, resume=True)
    assert len(asked) == 7
    swept([run], PLAIN, grid, tmp_path)
    assert len(asked) == 9


def test_a_damaged_record_is_made_anew(run, asked, tmp_path):
    swept([run], PLAIN, [(1, 0)], tmp_path)
    path = tmp_path / "seed0" / "H1" / "swept.json"
    for damage in ("{", "[]", json.dumps({**json.loads(path.read_text()), "odd": 1})):
        path.write_text(damage)
        swept([run], PLAIN, [(1, 0)], tmp_path, resume=True)
    assert len(asked) == 4


def test_a_failure_is_told_and_spoils_no_other(run, asked, tmp_path):
    found = swept([run], PLAIN, grid_of((1,), 3), tmp_path)
    assert [one.failure for one in found] == ["", "", "run.csv: it diverges."]
    write_sweep(found, tmp_path)
    rows = list(csv.DictReader((tmp_path / "sweep.csv").open()))
    assert [row["seed"] for row in rows] == ["0", "1", "2"]
    assert float(rows[1]["R"]) == pytest.approx(found[1].parameters["R"])
    assert rows[2]["R"] == "nan"
    assert rows[2]["failure"] == "run.csv: it diverges."
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")
    (kept,) = swept([run], PLAIN, [(1, 2)], tmp_path, resume=True)
    assert kept.failure == "run.csv: it diverges."
    assert np.isinf(kept.free_run_rmse)


@pytest.mark.parametrize(
    ("horizons", "seeds", "words"),
    [
        ((), 1, "horizons"),
        ((0, 1), 1, "horizons"),
        ((2, 2), 1, "distinct"),
        ((1,), 0, "0 seeds"),
        ((1,), 10**12, "give 1 to 10000"),
    ],
)
def test_an_empty_grid_is_refused(horizons, seeds, words):
    with pytest.raises(InputError, match=words):
        grid_of(horizons, seeds)


def test_a_horizon_that_no_recording_has_is_refused_before_any_training(run, asked, tmp_path):
    grid = grid_of((1, 10**9), 1)
    with pytest.raises(InputError, match=r"horizon 1000000000 .*shorten the horizon"):
        swept([run], PLAIN, grid, tmp_path)
    assert asked == []
    assert list(tmp_path.iterdir()) == []
