"""Every numbered script in examples/ runs, finds what it says it finds, and goes through penode."""

import importlib
import os
from pathlib import Path

import numpy as np
import pytest
from validate.command import identify, run

from penode.data.save import save
from penode.predictors.base import Predictor
from penode.validation.free_run import compare

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("PENODE_DATA", ROOT.parent / "shared" / "data")) / "benchmarks"
SCRIPTS = sorted((ROOT / "examples").glob("[0-9]*.py"))


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Let the scripts be imported by name, as in their folder."""
    monkeypatch.syspath_prepend(ROOT / "examples")


def example(name):
    """Return a script as a module."""
    return importlib.import_module(name)


def report_of(fit, folder):
    """Save a fit of an own model and return what ``penode report`` makes of it."""
    fit.save(folder)
    ended = run("report", folder, "--trust-classes")
    assert ended.status == 0, ended.printed
    assert not [line for line in ended.warned if line.startswith("RuntimeWarning")]
    assert "please send in" not in ended.printed
    return (folder / "report.html").read_text()


def needed(*parts):
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{path} is absent; name its folder in PENODE_DATA.")
    return path


def test_there_are_five_scripts_of_at_most_a_hundred_lines():
    assert len(SCRIPTS) == 5
    assert all(len(script.read_text().splitlines()) <= 100 for script in SCRIPTS)


def test_rlc_circuit(tmp_path):
    rlc = example("01_rlc")
    run = rlc.load(needed("rlc", "RLC_data_id.csv"))
    fit = rlc.identify(run.between(0, 2000), horizons=(30,))
    assert fit.parameters["R"].value == pytest.approx(3.0, rel=0.03)
    assert fit.parameters["C"].value == pytest.approx(270e-9, rel=0.03)
    assert rlc.inductance_error(fit, run) < 0.05
    assert "Left out" not in report_of(fit, tmp_path)


def test_positioner_mass_is_right_at_short_horizons_and_drifts_at_long_ones(tmp_path):
    emps = example("02_emps")
    fit = emps.sweep(emps.load(needed("emps", "DATA_EMPS.mat")))
    assert "Left out" not in report_of(fit, tmp_path)
    ladder = fit.horizon.ladder
    error = {rung.horizon: rung.parameters["M"] / 95.11 - 1 for rung in ladder}
    assert all(abs(error[h]) < 0.005 for h in (1, 2, 5, 10, 20))
    assert -0.035 < error[1000] < -0.015
    assert -0.035 < error[2000] < -0.015


@pytest.mark.slow
def test_positioner_with_learned_friction_simulates_a_recording_it_has_not_seen():
    emps = example("02_emps")
    run, pulses = (emps.load(needed("emps", f"DATA_EMPS{part}.mat")) for part in ("", "_PULSES"))
    fit = emps.learn_friction(run, horizons=(20, 200, 1000))
    assert compare(Predictor(1e-3), fit.model, pulses).free_run_rmse < 4e-3


def test_temperature_lab_heat_transfer_over_the_horizon(tmp_path):
    lab = example("03_tclab")
    fit = lab.sweep(lab.load(needed("tclab", "data.csv")))
    assert "Left out" not in report_of(fit, tmp_path)
    ladder = fit.horizon.ladder
    found = {rung.horizon: rung.parameters["U"] for rung in ladder}
    assert found[1] == pytest.approx(1.1, abs=0.1)
    assert found[10] == pytest.approx(1.3, abs=0.1)
    assert found[50] == pytest.approx(2.1, abs=0.15)
    assert found[200] == pytest.approx(3.0, rel=0.1)
    assert found[300] == pytest.approx(3.0, rel=0.1)


def test_machine(tmp_path, capsys):
    example("04_pmsm").main(tmp_path / "fit", duration=0.4)
    assert "ohm" in capsys.readouterr().out
    assert (tmp_path / "fit" / "result.json").exists()


def test_recordings_of_the_machine_go_through_the_command(tmp_path):
    machine, files = example("04_pmsm"), [tmp_path / "train.csv", tmp_path / "unseen.csv"]
    for file, speed, duration in zip(files, (1500.0, 900.0), (0.4, 0.2), strict=True):
        save(machine.record(speed, duration), file)
    few = ("--horizon", 3, "--no-inverter", "--angle-orders", "none", "--hold", "dq")
    ended = identify(files[:1], tmp_path / "result", "--validate", files[1], *few)
    assert ended.status in (0, 1), ended.printed
    assert not [line for line in ended.warned if line.startswith("RuntimeWarning")]
    assert "please send in" not in ended.printed
    assert ended.result["parameters"]["R"]["value"] > 0
    assert [one.role for one in ended.fit().comparisons] == ["train", "validation"]


def test_own_equation(tmp_path, capsys):
    pendulum = example("05_own_ode")
    fit = pendulum.identify(pendulum.record(1), horizons=(12, 50))
    assert fit.parameters["stiffness"].value == pytest.approx(9.0, rel=0.01)
    assert fit.parameters["gain"].value == pytest.approx(1.5, rel=0.01)
    speed = np.linspace(-2.5, 2.5, 40)
    learned = np.asarray(fit.friction_at(speed))
    assert np.abs(learned - pendulum.true_friction(speed)).max() < 0.15
    page = report_of(fit, tmp_path)
    assert "stiffness" in page
    assert "Left out" not in page
