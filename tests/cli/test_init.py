"""From a file with foreign names to a result: init, then identify with what it wrote."""

import json

import numpy as np
import polars as pl
import pytest

from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import simulate


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Write a short recording with another bench's names, in rpm, deg, kV and mA."""
    run = simulate(TRACTION_300A, Lissajous(200.0, 140.0, 150.0), speed_rpm=900.0, duration=0.1)
    path, c = tmp_path_factory.mktemp("bench") / "bench.parquet", run.channels
    columns = {
        "time_ms": np.arange(len(run)) * run.time_step * 1e3,
        "Iq_mA": c["i_q"] * 1e3,
        "Id_mA": c["i_d"] * 1e3,
        "Ud_kV": c["u_d"] / 1e3,
        "Uq_kV": c["u_q"] / 1e3,
        "n_rpm": c["omega_el"] / 5 * 30 / np.pi,
        "theta_deg": np.degrees(c["theta_el"]),
    }
    pl.DataFrame(columns).write_parquet(path)
    return path


def test_what_init_writes_works_untouched(recording, penode, tmp_path):
    config, out = tmp_path / "study.toml", tmp_path / "out"
    done = penode("init", recording, "--out", config)
    assert done.returncode == 0, done.stderr
    assert "omega_el  n_rpm in rpm, mechanical" in done.stdout
    assert "guessed" in done.stdout
    options = ("--horizon", 1, "--no-inverter", "--angle-orders", "none")
    done = penode("identify", recording, "--config", config, *options, "--out", out)
    assert done.returncode == 0, done.stderr
    result = json.loads((out / "result.json").read_text())
    assert result["horizon"]["selected"] == 1  # the option, not the file's auto
    assert result["provenance"]["pole_pairs"] == 5
    assert result["parameters"]["R"]["value"] == pytest.approx(0.01, rel=0.2)


def test_init_never_overwrites(recording, penode, tmp_path):
    config = tmp_path / "study.toml"
    config.write_text("mine")
    done = penode("init", recording, "--out", config)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "study.toml: this file exists" in done.stderr
    assert config.read_text() == "mine"


def test_init_says_what_it_could_not_find(penode, tmp_path):
    run, config = tmp_path / "run.csv", tmp_path / "study.toml"
    run.write_text("t,Id,Iq,n_mech\n" + "".join(f"{k / 1e3},{k},{k},900\n" for k in range(9)))
    done = penode("init", run, "--out", config)
    assert done.returncode == 0, done.stderr
    assert "Fill in before you use it: column of u_d, column of u_q, pole_pairs." in done.stdout
    done = penode("identify", run, "--config", config, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "pole_pairs is missing" in done.stderr


def test_init_refuses_what_cannot_be_read_and_leaves_nothing(penode, tmp_path):
    done = penode("init", tmp_path / "gone.csv", "--out", tmp_path / "study.toml")
    assert done.returncode == 2
    assert "gone.csv: file not found" in done.stderr
    assert not (tmp_path / "study.toml").exists()


def test_identify_refuses_a_bad_study_file_in_one_sentence(recording, penode, tmp_path):
    config = tmp_path / "study.toml"
    config.write_text("horizn = 3\n")
    done = penode("identify", recording, "--config", config, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "did you mean horizon?" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
