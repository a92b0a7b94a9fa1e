"""Every numbered script in examples/ runs, finds what it says it finds, and goes through penode."""

import importlib
import os
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from validate.command import identify, run
from validate.learned_sets import LEARNED

import penode
from penode.data.save import save
from penode.data.windows import Jittered
from penode.horizon.default_plan import default_plan
from penode.horizon.selection import Longest
from penode.training.loss import Loss
from penode.training.penalties import Smoothness
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


#: Of the scripts on public recordings: folder of the set, and a file in it.
OFFICIAL = {
    "01_rlc": ("rlc", "RLC_data_id.csv"),
    "02_emps": ("emps", "DATA_EMPS.mat"),
    "03_tclab": ("tclab", "data.csv"),
    "06_tanks": ("tanks", "dataBenchmark.csv"),
    "07_silverbox": ("silverbox", "multisine.csv"),
    "08_bouc_wen": ("bouc_wen", "train.h5"),
}


def official(name):
    """Return what a script loads: start, training, test."""
    return example(name).load(needed(*OFFICIAL[name]).parent)


def fitted(start, run, horizons):
    """Fit at a few horizons, otherwise by default."""
    plan = replace(default_plan(start, [run]), stages=penode.ladder_plan(horizons).stages)
    return penode.identify(start, [run], plan=plan)


def test_there_are_eight_scripts_and_those_on_public_recordings_have_at_most_40_lines():
    lines = {script.stem: len(script.read_text().splitlines()) for script in SCRIPTS}
    assert lines.keys() == OFFICIAL.keys() | {"04_pmsm", "05_own_ode"}
    assert all(count <= (40 if name in OFFICIAL else 100) for name, count in lines.items())


@pytest.mark.parametrize("name", OFFICIAL)
def test_a_script_identifies_what_it_loads(name, monkeypatch):
    """As a command, but for the fit itself: its model predicts what it is given."""
    folder, given = needed(*OFFICIAL[name]).parent, []

    def identify(start, runs, validation):
        predictor = penode.Predictor(runs[0].time_step)
        ends = (run.between(0, 20) for run in (*runs, *validation))
        given.extend(compare(predictor, start, end).one_step for end in ends)

    monkeypatch.setattr(penode, "identify", identify)
    monkeypatch.setattr("sys.argv", [name, str(folder)])
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
    assert len(given) == 2


def test_rlc_circuit(tmp_path):
    start, run, _ = official("01_rlc")
    fit = fitted(start, run.between(0, 2000), (1, 5, 30))
    for name, true in (("R", 3.0), ("C", 270e-9), ("L", 50e-6)):
        found = fit.parameters[name]
        assert abs(found.value - true) < 4 * found.std < 0.15 * true
    assert "Left out" not in report_of(fit, tmp_path)


@pytest.mark.slow
def test_positioner_mass_is_right_at_short_horizons_and_drifts_at_long_ones(tmp_path):
    start, run, _ = official("02_emps")
    horizons = (10, 20, 50, 100, 200, 500, 1000, 2000)
    fit = penode.identify(start, [run], plan=penode.ladder_plan(horizons))
    assert "Left out" not in report_of(fit, tmp_path)
    ladder = fit.horizon.ladder
    error = {rung.horizon: rung.parameters["M"] / 95.11 - 1 for rung in ladder}
    assert all(abs(error[h]) < 0.005 for h in (10, 20))
    assert error[1000] < -0.015
    assert error[2000] < -0.015


@pytest.mark.slow
def test_positioner_with_learned_friction_simulates_a_recording_it_has_not_seen():
    start, run, pulses = official("02_emps")
    points = np.linspace(-0.13, 0.13, 53)[:, None] * [0.0, 1.0]
    smooth = Smoothness(points, step=np.array([0.0, 0.01]), weight=1e-7)
    plan = replace(
        penode.ladder_plan((20, 200, 1000)),
        placement=Jittered(stride=250),
        loss=Loss(penalties=(smooth,)),
    )
    start = LEARNED["emps+friction"](start)
    fit = penode.identify(start, [run], plan=plan, purpose=Longest())
    assert compare(penode.Predictor(1e-3), fit.model, pulses).free_run_rmse < 4e-3


@pytest.mark.slow
def test_temperature_lab_whose_sensors_lag_predicts_the_other_half(tmp_path):
    start, run, unseen = official("03_tclab")
    fit = fitted(start, run, (60, 240))
    assert "Left out" not in report_of(fit, tmp_path)
    assert 10 < fit.parameters["tau"].value < 30
    predicted = compare(penode.Predictor(run.time_step), fit.model, unseen)
    assert predicted.free_run_rmse < 1.5


def test_machine(tmp_path, capsys):
    example("04_pmsm").main(tmp_path / "fit", duration=0.4)
    assert "ohm" in capsys.readouterr().out
    assert (tmp_path / "fit" / "result.json").exists()


@pytest.mark.slow
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
