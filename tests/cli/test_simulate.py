"""The simulated bench from the command line."""

import json

import numpy as np
import polars as pl
import pytest

CONFIG = """
machine = "traction_300A"
speed_rpm = 900.0
duration = 0.05
seed = 3

[reference]
kind = "lissajous"
amplitude = 150.0
rate_d = 140.0
rate_q = 150.0
domain = "motor"

[drive]
current_noise = 0.2

[drive.inverter.dead_time]
duration = 0.5e-6
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text(CONFIG)
    return path


def test_recording_truth_map_and_picture_are_written(config, penode, tmp_path):
    out, picture = tmp_path / "run.parquet", tmp_path / "run.png"
    done = penode("simulate", config, "--out", out, "--picture", picture)
    assert done.returncode == 0, done.stderr
    table = pl.read_parquet(out)
    assert table.columns == ["t", "u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el"]
    assert len(table) == 500
    truth = json.loads((tmp_path / "run.truth.json").read_text())
    assert truth["resistance"] == pytest.approx(0.01)
    assert truth["mean_speed_rpm"] == pytest.approx(900.0)
    assert truth["dead_time_voltage"] == pytest.approx(400.0 * 0.5e-6 / 1e-4)
    assert truth["seed"] == 3
    true_map = np.loadtxt(tmp_path / "run.truth.csv", delimiter=",", skiprows=1)
    at_zero = true_map[np.argmin(np.hypot(true_map[:, 0], true_map[:, 1]))]
    assert at_zero[2] == pytest.approx(0.0577, rel=0.02)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"traction_300A"', '"toaster"', ["toaster", "comsol_300A"]),
        ("duration = 0.05", 'duration = "long"', ["duration", "long"]),
        ("seed = 3", "sneed = 3", ["sneed", "duration"]),
        ('kind = "lissajous"', 'kind = "doodle"', ["reference", "doodle", "spiral"]),
        ("rate_q = 150.0", "", ["reference", "rate_q", "missing"]),
        ("amplitude = 150.0", "amplitude = 1500.0", ["1500"]),
        ("speed_rpm = 900.0", "speed_rpm = 9000.0", ["voltage"]),
        ("[drive.inverter.dead_time]", "[drive.inverter.dead_time", ["run.toml", "TOML"]),
    ],
)
def test_unusable_configuration_gets_one_sentence(config, penode, tmp_path, old, new, words):
    config.write_text(CONFIG.replace(old, new))
    done = penode("simulate", config, "--out", tmp_path / "run.csv")
    assert done.returncode == 2
    assert done.stderr.strip().count("\n") == 0, done.stderr
    for word in words:
        assert word in done.stderr
    assert not (tmp_path / "run.csv").exists()


def test_only_what_a_simulation_wrote_is_replaced(config, penode, tmp_path):
    out = tmp_path / "run.csv"
    out.write_text("measured on the bench\n")
    done = penode("simulate", config, "--out", out)
    assert done.returncode == 2
    assert done.stderr.strip().count("\n") == 0, done.stderr
    assert "was not written by a simulation" in done.stderr
    assert out.read_text() == "measured on the bench\n"
    out.unlink()
    assert "replaced" not in penode("simulate", config, "--out", out).stdout
    again = penode("simulate", config, "--out", out)
    assert again.returncode == 0, again.stderr
    assert "(replaced)" in again.stdout


def test_unknown_name_and_suffix_are_refused(config, penode, tmp_path):
    done = penode("simulate", "paper_toaster", "--out", tmp_path / "run.csv")
    assert done.returncode == 2
    assert "paper_simulation" in done.stderr
    done = penode("simulate", config, "--out", tmp_path / "run.xls")
    assert done.returncode == 2
    assert ".parquet" in done.stderr
