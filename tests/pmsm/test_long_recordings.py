"""Recordings of more samples than an identification uses, and of more than fit in memory."""

from dataclasses import replace

import numpy as np
import pytest

import penode
from penode.data import content, gathered
from penode.data.gathered import mapping_of
from penode.errors import InputError
from penode.pmsm.balance.calibration import AS_RECORDED
from penode.pmsm.precheck import unused_samples
from penode.pmsm.precheck.unused_samples import squared_errors
from penode.pmsm.recording_check import check_recordings
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study
from penode.predictors.base import Predictor
from penode.validation.free_run import compare

STUDY = Study(samples=4000, horizon=2, candidates=(), angle_orders=(), hold="dq")


@pytest.fixture
def small_pieces(monkeypatch):
    """Keep columns of more than 500 samples on disk, and take 300 at a time."""
    monkeypatch.setattr(gathered, "MANY", 500)
    monkeypatch.setattr(gathered, "PIECE", 300)
    monkeypatch.setattr(content, "_LARGE", 1000)


@pytest.fixture(scope="module")
def fit(slow_run):
    return identify([slow_run], study=STUDY)


def test_what_was_used_is_said(fit, slow_run):
    sentence = fit.provenance["structure"][0]
    assert "Of 10\N{NO-BREAK SPACE}000 samples 4\N{NO-BREAK SPACE}000 were used" in sentence
    (seen,) = fit.comparisons
    assert seen.name.startswith(f"{slow_run.name} rows ")
    assert len(seen.measured) == 4000
    first = int(seen.name.rpartition(" rows ")[2].split()[0]) - 1
    currents = slow_run.stack(("i_d", "i_q"))[first : first + 4000]
    np.testing.assert_array_equal(seen.measured, currents)
    assert fit.provenance["placement"] == "Jittered(seed=0, stride=None, shortest=5, fewest=1)"


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_file_read_in_pieces_gives_the_fit_of_the_recording_in_memory(
    fit, slow_run, tmp_path, small_pieces, suffix
):
    penode.save(slow_run, tmp_path / f"run{suffix}")
    run = penode.load(tmp_path / f"run{suffix}", name=slow_run.name)
    for name, values in slow_run.channels.items():
        assert mapping_of(run.channels[name]) is not None
        np.testing.assert_array_equal(run.channels[name], values)
    assert run.time_step == pytest.approx(slow_run.time_step, rel=1e-12)
    if suffix == ".parquet":
        again = identify([replace(run, time_step=slow_run.time_step)], study=STUDY)
        assert again.parameters["R"] == fit.parameters["R"]
        np.testing.assert_array_equal(again.flux_map(50.0, -80.0), fit.flux_map(50.0, -80.0))


def test_a_check_in_pieces_finds_the_same(slow_run, tmp_path, small_pieces):
    penode.save(slow_run, tmp_path / "run.parquet")
    run = penode.load(tmp_path / "run.parquet", name=slow_run.name)
    found, whole = (check_recordings([e], STUDY).as_json() for e in (run, slow_run))
    assert found["recordings"][0].pop("time_step") == pytest.approx(slow_run.time_step, rel=1e-12)
    assert whole["recordings"][0].pop("time_step") == slow_run.time_step
    assert found["quality"] == whole["quality"]
    assert found["conventions"] == whole["conventions"]
    numbers = ("independence",)
    for name in numbers:
        for parameter, value in whole["identifiability"][name].items():
            assert found["identifiability"][name][parameter] == pytest.approx(value, rel=1e-9)


def test_errors_over_pieces_are_those_of_the_whole(fit, slow_run, monkeypatch):
    predictor = Predictor(slow_run.time_step)
    whole = compare(predictor, fit.model, slow_run).one_step_residual ** 2
    monkeypatch.setattr(unused_samples, "PIECE", 1000)
    errors = squared_errors(fit.model, predictor, slow_run, AS_RECORDED)
    pieces = [whole[first : first + 1000].mean() for first in range(0, len(whole), 1000)]
    np.testing.assert_allclose(errors, pieces, rtol=1e-9)


def test_what_goes_wrong_in_samples_that_were_not_used_is_an_objection(fit, slow_run):
    predictor = Predictor(slow_run.time_step)
    (seen,) = fit.comparisons
    unused = 9000 if int(seen.name.rpartition(" rows ")[2].split()[0]) < 4000 else 100
    currents = slow_run.channels["i_d"].copy()
    currents[unused] += 1e4
    spiked = replace(slow_run, channels={**slow_run.channels, "i_d": currents})
    for run, raised in ((slow_run, []), (spiked, ["unlike the rest"])):
        check = unused_samples.unused_samples([run], AS_RECORDED, predictor)
        objections = list(check(fit, []))
        assert [objection.name for objection in objections] == raised
    first = unused // unused_samples.PIECE * unused_samples.PIECE
    assert f"data rows {first + 1} to " in objections[0].reason


def test_no_samples_are_refused():
    with pytest.raises(InputError, match="samples must be >= 1, got 0"):
        Study(samples=0)
