"""A small case of every module of `validate`: what makes the published tables runs.

One recording goes through the command once; its result is what most modules judge.
"""

import importlib
import importlib.util
import json
import os
import pkgutil
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from validate.command import identify
from validate.drawn_recordings import draw_campaign
from validate.examples import example
from validate.identified import EXACT, Identified, identified, outcome
from validate.other_simulators import plan as planning
from validate.other_simulators import table
from validate.other_simulators.drive_log import DriveLog
from validate.other_simulators.references import PROFILES, REFERENCES
from validate.other_simulators.sensors import Sensors
from validate.other_simulators.wrong_logs import WRONG

import validate
from penode import Experiment, Predictor
from penode.arrays import float64
from penode.bench.drive import Drive
from penode.bench.inverter import Inverter
from penode.bench.machines import TRACTION_300A
from penode.data.save import save
from penode.fit.left_out import left_out
from penode.fit.outcome import Estimate
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.pmsm.exports.formats import export
from penode.pmsm.points.identify import ANSWERED
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import RK4
from penode.validation.free_run import compare
from validate import (
    accessibility,
    aliasing,
    conventions,
    drives_without_angle,
    exports_read,
    flux_maps,
    full_disk,
    horizon_choice,
    imperfect_drives,
    imperfections,
    imported_machine,
    interruption,
    learned_sets,
    ledger,
    map_errors,
    misfitting_drives,
    noise_models,
    operating_points,
    output_sets,
    processes,
    public_sets,
    random_starts,
    recordings_as_they_are,
    repetition,
    simulated_sets,
    sweep_interruption,
)

#: Modules with tests of their own, and those that run in an environment of other simulators.
TESTED = {
    "command", "golden", "drawn_logs", "drawn_physics", "physics", "through_command",
    "sampled_drive", "standstill", "pmsm_id",
}  # fmt: skip
ELSEWHERE = {
    "other_simulators.control_loci": "motulator",
    "other_simulators.gem_drive": "gym_electric_motor",
    "other_simulators.motulator_drive": "motulator",
    "other_simulators.record": "motulator",
    "pmsm_id.of_motulator": "motulator",
    "pmsm_id.peers": "jax_sysid",
}
HERE = {
    "accessibility", "aliasing", "bad_files", "conventions", "drawn_recordings",
    "drives_without_angle", "examples",
    "exports_read", "flux_maps", "full_disk", "horizon_choice", "identified", "imperfect_drives",
    "imperfections", "imported_machine", "interruption", "learned_sets", "ledger", "map_errors",
    "misfitting_drives", "noise_models", "operating_points", "other_simulators", "output_sets",
    "processes",
    "public_sets", "random_starts", "recordings_as_they_are", "repetition", "simulated_sets",
    "sweep_interruption",
}  # fmt: skip


def test_every_module_has_a_case():
    """A new module of `validate` joins HERE with a case below, or gets tests of its own."""
    found = {one.name for one in pkgutil.iter_modules(validate.__path__)}
    assert found == HERE | (TESTED & found)


@pytest.mark.parametrize("name", ELSEWHERE)
def test_what_needs_other_libraries_is_imported_where_they_are(name):
    source = Path(validate.__file__).parent / f"{name.replace('.', '/')}.py"
    compile(source.read_text(), source, "exec")
    if importlib.util.find_spec(ELSEWHERE[name]) is None:
        pytest.skip(f"{ELSEWHERE[name]} is not installed; it needs an environment of its own.")
    importlib.import_module(f"validate.{name}")


# --- one identification, shared ------------------------------------------------------------------


@pytest.fixture(scope="module")
def campaign():
    """One recording of 0.06 s, of a machine and a drive that were drawn."""
    return draw_campaign(5, duration=0.06)


@pytest.fixture(scope="module")
def ended(campaign, tmp_path_factory):
    """How the command ended with one horizon and nothing of the structure left to the data."""
    folder = tmp_path_factory.mktemp("out")
    save(campaign.runs[0], folder / "recording.csv")
    (folder / "study.toml").write_text(EXACT)
    options = ("--horizon", 2, "--no-inverter", "--angle-orders", "none", "--hold", "dq")
    return identify(
        [folder / "recording.csv"], folder / "result", *options, "--config", folder / "study.toml"
    )


@pytest.fixture(scope="module")
def done(ended):
    return outcome(ended)


def test_what_is_not_accessible_is_a_line_with_its_impact(tmp_path):
    (tmp_path / "page.html").write_text("<head></head>")
    found = [["serious", "image-alt", 2, "<img>"], ["minor", "region", 1, "<p>"]]
    browser = tmp_path / "browser"
    browser.write_text(f"#!/bin/sh\necho '<pre>AXE{json.dumps(found)}EXA</pre>'\n")
    browser.chmod(0o755)
    lines = list(accessibility.rows([tmp_path / "page.html"], str(browser), "axe"))
    assert len(lines) == 8
    line = "page.html 1400 px light: serious image-alt, 2 elements: <img>"
    assert (lines[0][0].endswith(line), lines[0][1], lines[1][1]) == (True, True, False)
    assert [one.name for one in tmp_path.iterdir() if one.is_dir()] == []


REFUSED = Identified(None, "refused", "error: too short.", "", 0.1)
BROKEN = Identified(None, "status 70", "internal error", "exit status 70: internal error", 9.0)


@pytest.mark.slow
def test_the_command_ends_with_a_fit_and_nothing_to_note(ended, done):
    assert ended.status == 1, ended.printed  # 60 ms at one speed cannot determine R
    assert (done.verdict, done.noted, done.told) == ("not identifiable", "", "")
    assert done.fit.parameters["R"].value > 0
    assert (ended.out / "report.html").exists()


def test_a_recording_that_is_refused_leaves_no_files(campaign, monkeypatch, tmp_path):
    monkeypatch.setattr("validate.identified.FOLDER", tmp_path)
    run = campaign.runs[0]
    few = replace(run, channels={name: values[:3] for name, values in run.channels.items()})
    found = identified("few/samples!", [few])
    assert (found.fit, found.verdict, found.noted) == (None, "refused", "")
    assert "at least 8 samples, got 3" in found.why
    assert not list(tmp_path.rglob("*.csv"))


@pytest.mark.slow
def test_what_no_run_should_show_is_noted(ended):
    crashed = outcome(replace(ended, status=70, out=None, printed="internal error"))
    assert (crashed.verdict, crashed.fit) == ("status 70", None)
    assert crashed.told == "  !! exit status 70: internal error"
    warned = outcome(replace(ended, warned=("RuntimeWarning: overflow (a.py:3)", "UserWarning: x")))
    assert warned.noted == "RuntimeWarning: overflow (a.py:3)"
    sentence = left_out("the picture", ValueError("x"))
    partly = outcome(replace(ended, printed=f"Dead time was left out.\n{sentence}"))
    assert partly.noted == sentence


# --- tables of runs of the command ---------------------------------------------------------------


def test_horizon_choice(campaign, done, capsys):
    good = horizon_choice.record_of(campaign, done, replace(done, verdict="not identifiable"))
    positive = json.loads(json.dumps({"draw": 0, **good, "verdict": "plateau"}))
    assert positive["error"] == done.fit.parameters["R"].value / campaign.machine.resistance - 1
    broken = {"draw": 1, **horizon_choice.record_of(campaign, BROKEN, None)}
    assert "free map not identifiable" in horizon_choice.line_of(positive)
    assert "!! exit status 70: internal error" in horizon_choice.line_of(broken)
    horizon_choice.print_table([positive, broken])
    printed = capsys.readouterr().out
    assert "1 of 2 verdicts are positive" in printed
    assert "1 of 2 ended otherwise than promised" in printed
    horizon_choice.print_table([broken])
    assert "0 of 1 verdicts are positive" in capsys.readouterr().out


def test_imperfect_drives(done, capsys):
    drive, there = imperfect_drives.draw_drive(np.random.default_rng(1))
    assert ("delay" in there) or drive.inverter.delay == 0
    truth = done.fit.parameters["R"].value / 1.1
    good = imperfect_drives.record_of(done, replace(done, noted="a warning"), truth, there)
    good = json.loads(json.dumps({"draw": 0, **good, "verdict": "plateau"}))
    assert good["error"] == pytest.approx(0.1)
    assert "!! a warning" in imperfect_drives.line_of(good)
    refused = {"draw": 1, **imperfect_drives.record_of(REFUSED, done, truth, there)}
    assert "refused: error: too short." in imperfect_drives.line_of(refused)
    imperfect_drives.print_table([good, refused])
    printed = capsys.readouterr().out
    assert "1 of 2 verdicts are positive" in printed
    assert "width over that of what is told: 1.00" in printed


def test_drives_without_an_angle_are_identified_without_it(done, monkeypatch):
    seen = []
    monkeypatch.setattr(
        drives_without_angle, "identified", lambda name, runs: seen.append(runs) or done
    )
    one = {"draw": 3, **drives_without_angle.result_of(3)}
    assert "theta_el" not in seen[0][0].channels
    assert one["law"] == "switch"
    assert "inverter" in drives_without_angle.line_of(one)


def test_misfitting_drives_have_laws_that_no_term_has(done, capsys):
    machine, drive = TRACTION_300A, Drive(inverter=Inverter())
    for law in misfitting_drives.LAWS:
        random = np.random.default_rng(1)
        other, misfitting, told = misfitting_drives.with_law(random, law, machine, drive, 1000.0)
        assert (other, misfitting) != (machine, drive), told
    knee = misfitting_drives.PowerKnee(2.0, 0.0, 5.0, exponent=3.0).drop(
        np.array([5.0, -50.0, 0.0])
    )
    np.testing.assert_allclose(knee, [2 / 2 ** (1 / 3), -2 * 10 / 1001 ** (1 / 3), 0.0], rtol=1e-6)
    iron = misfitting_drives.PowerIron(50.0, -1.0, 20.0).current(np.array([30.0, 40.0]))
    np.testing.assert_allclose(iron, [20 * 0.6 / 50, 20 * 0.8 / 50], rtol=1e-6)
    truth = done.fit.parameters["R"].value
    one = {"draw": 0, **misfitting_drives.record_of(done, truth, "knee", "1 V")}
    other = {"draw": 1, **misfitting_drives.record_of(REFUSED, truth, "iron", "50 ohm")}
    assert "covered" in misfitting_drives.line_of(one)
    assert "refused: error: too short." in misfitting_drives.line_of(other)
    misfitting_drives.print_table([one | {"verdict": "plateau"}, other])
    assert "knee   1 of 1 positive, 1 cover (100 %)" in capsys.readouterr().out


def test_imperfections(done, campaign, monkeypatch, capsys):
    monkeypatch.setattr(imperfections, "MACHINE", campaign.machine)
    text = imperfections.text_of("none", done, done.fit.parameters["R"].value)
    assert "+0.00" in text
    assert text.split("\n")[0].endswith("not identifiable")
    assert "error: too short." in imperfections.text_of("none", REFUSED, 1.0)
    assert "!! exit status 70" in imperfections.text_of("none", BROKEN, 1.0)
    monkeypatch.setattr(imperfections, "recorded", lambda: campaign.runs[0])
    late = imperfections.late(1.0)
    np.testing.assert_array_equal(late.channels["u_d"][:-1], campaign.runs[0].channels["u_d"][1:-1])
    scaled = imperfections.scaled(("i_d",), 1.01).channels
    np.testing.assert_allclose(scaled["i_d"], 1.01 * campaign.runs[0].channels["i_d"])


@pytest.mark.slow
def test_other_simulators(done, ended, campaign, tmp_path, monkeypatch, capsys):
    truth = {
        "number": 0, "half": "developing", "kind": "clean", "machine": "drawn", "files": ["a.csv"],
        "speeds_rpm": [1000.0], "R": done.fit.parameters["R"].value, "flux_map": {},
    }  # fmt: skip
    i_d, i_q = done.fit.excited[::20].T
    psi_d, psi_q = done.fit.flux_map(i_d, i_q)
    samples = {"i_d": i_d, "i_q": i_q, "psi_d": psi_d, "psi_q": psi_q}
    truth["flux_map"] = {name: values.tolist() for name, values in samples.items()}
    file = ended.out.parent / "recording.csv"
    good = table.record_of(done, [file], truth) | {"verdict": "plateau"}
    assert good["map"] < 1e-6
    assert table.mark_of(truth, good) == "right"
    assert "right" in table.line_of(truth, good)
    broken, refused = (table.record_of(one, [file], truth) for one in (BROKEN, REFUSED))
    assert table.mark_of(truth, broken) == "broken"
    assert "!! exit status 70" in table.line_of(truth, broken)
    pairs = [(truth, one) for one in (good, broken, refused)]
    assert "1 of 3 verdicts are positive" in table.summary(pairs)
    assert "1 ended otherwise" in table.summary(pairs)
    monkeypatch.setattr(table, "FOLDER", tmp_path)
    monkeypatch.chdir(tmp_path)
    head = {"versions": {"a": "1"}, "recordings": {"0": truth}}
    (tmp_path / "truth.json").write_text(json.dumps(head))
    monkeypatch.setattr(table, "result_of", lambda truth: good)
    table.print_table(("developing",))
    assert "1 of 1 verdicts are positive" in capsys.readouterr().out


# --- what the other simulators are given ---------------------------------------------------------


def test_the_plan_has_two_recordings_a_kind_with_different_machines():
    planned = planning.plan()
    assert [one.number for one in planned] == list(range(2 * len(planning.KINDS)))
    for even, odd in zip(planned[::2], planned[1::2], strict=True):
        assert even.kind == odd.kind
        assert (even.half, odd.half) == planning.HALVES
        assert even.machine != odd.machine


@pytest.mark.parametrize("name", WRONG)
def test_a_log_goes_wrong_in_one_way(name, tmp_path):
    time = np.arange(200) * 1e-4
    angle = 600.0 * time
    log = DriveLog(
        5 * np.exp(3j * time), 20 * np.exp(2j * time), np.full(200, 600.0), angle, link=400.0
    )
    planned = planning.plan()[0]
    changed = WRONG[name](log, planned, 0)
    parts = ("current", "voltage", "speed", "angle")
    same = [np.array_equal(getattr(changed, part), getattr(log, part)) for part in parts]
    assert all(same) == (name in ("", "lag"))  # a steady speed does not lag
    changed.after(10).write(tmp_path / "log.csv")
    assert len((tmp_path / "log.csv").read_text().splitlines()) == 191


def test_references_and_profiles_are_finite_functions_of_time():
    times, random = np.linspace(0, 1.2, 50), np.random.default_rng(1)
    for make in REFERENCES.values():
        figure = make(10.0, 1.0, random)
        assert np.isfinite([figure(t) for t in times]).all()
    for profile in PROFILES.values():
        assert np.isfinite([profile(100.0, 1.2)(t) for t in times]).all()
    assert Sensors


# --- the others ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_ledger_goes_on_where_it_stopped(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["x", "3", "5"])
    made = []

    def make(number):
        made.append(number)
        return {"value": 2 * number}

    for _ in range(2):
        ledger.run_draws("x", 9, make, lambda one: str(one["value"]), lambda all: print(len(all)))
    assert made == [5, 6, 7]
    assert capsys.readouterr().out.split() == ["10", "12", "14", "3"] * 2


def test_map_errors_of_a_map_against_itself(done, campaign):
    grid = map_errors.rectangle(done.fit)
    assert grid.min(axis=0) == pytest.approx(done.fit.excited.min(axis=0))
    error, covered = map_errors.error_and_coverage(done.fit, campaign.machine)
    assert 0 < error < 0.2
    assert 0 <= covered <= 1


def test_flux_maps(done, campaign):
    found = flux_maps.figures(done.fit, campaign.machine)
    assert found["L"] > 0
    assert found["L_d"] >= found["L"]
    machines = [make() for make in (flux_maps.surface, flux_maps.reluctance, flux_maps.saturated)]
    assert len({machine.coenergy for machine in machines}) == 3
    assert flux_maps.staircase()(np.linspace(0, 0.9, 20)).shape == (20, 2)
    assert not flux_maps.only_d(np.linspace(0, 1, 9))[:, 0].any()


def test_exports_are_read_back(done):
    """Of what is installed; those that need other programs say so."""
    lines = list(exports_read.rows(done.fit))
    assert [line.split()[0] for line in lines] == [
        *("mat", "m", "syre", "motorcad", "c", "npz", "xlsx", "onnx")
    ]
    read = [float(re.search(r"at points (\S+),", x)[1]) for x in lines if "at points" in x]
    assert len(read) >= 1
    assert max(read) < 1e-6
    assert all("at points" in x or "not installed" in x for x in lines)


def test_random_starts(done, capsys):
    fit = done.fit
    assert random_starts.loss_of(fit) == fit.horizon.ladder[-1].rmse ** 2
    other = random_starts.disturbed(fit.model, 3)
    assert np.any(
        other.flux.network.mean[0].coefficients != fit.model.flux.network.mean[0].coefficients
    )
    arrived = {"draw": 0, "text": "", "failure": "", "excess": 1e-5, "apart": 0.1, "finite": True}
    random_starts.print_table([arrived, {"draw": 1, "text": "", "failure": "refused."}])
    assert "1 of 2 starts are within 0.1 %" in capsys.readouterr().out
    assert random_starts.line_of(arrived).startswith("  0")


def test_aliasing():
    assert aliasing.hump({18: 1.0, 20: 5.0, 22: 3.0}, 20) == 3.0
    assert all(h - 2 in aliasing.HORIZONS for h in aliasing.HORIZONS if h % aliasing.PERIOD == 0)


def test_conventions():
    """Every case breaks a recording in its way, and the rows stay together."""
    time = 1e-4 * np.arange(300)
    names = ("u_d", "u_q", "i_d", "i_q")
    channels = {name: 10 * np.sin((60 + 9 * k) * time + k) for k, name in enumerate(names)}
    channels |= {"omega_el": np.full(300, 500.0), "theta_el": np.mod(500.0 * time, 2 * np.pi)}
    run = Experiment("run.csv", 1e-4, channels)
    for case, wrong in conventions.WRONG.items():
        changed = wrong.how(run, 4, np.random.default_rng(2))
        assert len({len(values) for values in changed.channels.values()}) == 1
        shared = changed.channels.keys() & channels.keys()
        same = all(np.array_equal(changed.channels[n], channels[n]) for n in shared)
        moved = case in ("current phases swapped", "voltage phases swapped", "phase voltages late")
        assert same == (not wrong.name) or moved, case


def test_imported_machine(machine_fit, tmp_path):
    export(machine_fit, "csv", tmp_path / "map.csv")
    imported = imported_machine.imported_from(str(tmp_path / "map.csv"), 0.01, 5)
    assert imported.machine.resistance == 0.01
    assert imported.findings.fit_error < 1e-3


def test_processes_and_what_they_took():
    assert processes.spent(os.getpid()) > 0
    assert processes.spent(2**30) == 0.0
    assert processes.tree(os.getpid())[0] == os.getpid()
    assert processes.ended_children() >= 0
    assert sweep_interruption.ended([2**30], 0.1)
    assert isinstance(sweep_interruption.workers_of(os.getpid()), list)


def test_results_are_compared_by_what_they_say(ended):
    document, arrays = interruption.numbers(ended.out)
    assert arrays
    assert not {"command", "wall_time_s"} & set(document["provenance"])
    assert interruption.rungs(ended.out) == 0
    digests = repetition.content(ended.out)
    assert digests == repetition.content(ended.out)
    assert set(digests) == {"result.json", "fit.json", "fit.npz", "flux_map.csv"}
    with repetition.loaded(False):
        pass


def test_what_is_left_on_a_full_disk_is_named(ended, tmp_path):
    (tmp_path / "out").mkdir()
    before = full_disk.files(tmp_path)
    assert full_disk.left(tmp_path, before, 2) == "as before"
    assert full_disk.Outcome(2, "error: no space left.", "as before").fine
    assert not full_disk.Outcome(1, "", "as before").fine
    (tmp_path / "out" / "half").write_text("x")
    assert full_disk.left(tmp_path, before, 2) not in ("as before", "horizons kept", "whole result")


@pytest.mark.slow
def test_bad_files():
    """One row of the table, by the real command in a process of its own.

    Imported here, as the import makes its files.
    """
    bad_files = importlib.import_module("validate.bad_files.__main__")
    rows = list(bad_files.bad())
    assert {heading for heading, *_ in rows} == set(bad_files.HEADINGS[:-1])
    assert len(rows) > 100
    assert len(list(bad_files.odd())) > 10
    _, kind, make, arguments = next(row for row in rows if row[0] == "text")
    end = bad_files.ended(make, arguments)
    assert bad_files.fault(end) == "", bad_files.line(kind, end, end.said, "")
    assert bad_files.fault(replace(end, status=70, left=("out",))) == "status 70; left out"
    assert bad_files.same("a 1.00000000001 b", "a 1.0 b")
    assert not bad_files.same("a 1.1 b", "a 1.0 b")


@pytest.mark.slow
def test_public_sets(tmp_path, capsys):
    """Tanks like the benchmark's, made here; both halves are one."""
    random, step = np.random.default_rng(2), 4.0
    pump = np.repeat(random.uniform(1.0, 4.0, 12), 15)
    level = np.array([[5.0, 5.0]])
    for u in pump[:-1]:
        now = level[-1].copy()
        for _ in range(40):
            upper, lower = np.sqrt(now)
            now += step / 40 * np.array([0.05 * u - 0.05 * upper, 0.05 * (upper - lower)])
        level = np.vstack([level, now])
    lower = level[:, 1] + 0.01 * random.normal(size=len(pump))
    (tmp_path / "tanks").mkdir()
    rows = np.stack([pump, pump, lower, lower], axis=1)
    file, header = tmp_path / "tanks" / "dataBenchmark.csv", "uEst,uVal,yEst,yVal"
    np.savetxt(file, rows, delimiter=",", header=header, comments="")
    public_sets.main([str(tmp_path), "tanks"])
    (line,) = capsys.readouterr().out.splitlines()
    assert "ZeroOrder " in line
    assert float(line.split(" simulation ")[1].split(";")[0]) < 0.02


STARTS = {
    "tanks+outflow": ("06_tanks", "Tanks", (0.05, 0.05, 0.05, 0.05, 0.5)),
    "silverbox+spring": ("07_silverbox", "CubicSpring", (1e5, 50.0, 2e5, 1e5, 0.0)),
    "bouc_wen+hysteresis": ("08_bouc_wen", "Hysteresis", (1.5, 5.0, 3e4, 3e4, 500.0, -500.0)),
    "emps+friction": ("02_emps", "Positioner", (80.0, 150.0, 10.0, 0.0)),
    "tclab+loss": ("03_tclab", "TemperatureLab", (10.0, 0.01, 0.0075, 10.0)),
}


def test_every_learned_part_but_the_inductance_stands_beside_a_law():
    assert learned_sets.LEARNED.keys() == STARTS.keys() | {"rlc+inductance"}


def rates(model, x, u):
    """Return the derivative at states (state, batch) and inputs (input, batch)."""
    with float64():
        return np.asarray(with_batch_axis(model).derivative(x, Inputs(u, model.inputs)))


@pytest.mark.parametrize("name", STARTS)
def test_a_learned_part_that_is_zero_changes_nothing_and_another_one_does(name):
    script, kind, values = STARTS[name]
    plain = getattr(example(script), kind)(*values)
    model, random = learned_sets.LEARNED[name](plain), np.random.default_rng(3)
    x = 300.0 + random.normal(size=(4, 7)) if kind == "TemperatureLab" else random.random((3, 7))
    x, u = x[: len(plain.states)] * (0.1 if kind == "Positioner" else 1), random.random((2, 7))
    u = u[: len(plain.inputs)]
    np.testing.assert_array_equal(rates(model, x, u), rates(plain, x, u))
    assert not np.asarray(with_batch_axis(model).learned(x)).any()
    other = jax.tree.map(lambda leaf: leaf + (leaf.ndim > 0), model)
    changed = (rates(other, x, u) != rates(plain, x, u)).any(axis=1)
    assert changed[-1] or changed[0]


@pytest.mark.parametrize("name", ["two_mass", "van_de_vusse", "lotka_volterra"])
def test_a_simulated_set_follows_its_model_with_the_true_parameters(name):
    start, (train, test), truth = getattr(simulated_sets, name)(60)
    assert truth.keys() == {key for key, one in vars(start).items() if np.ndim(one) == 0}
    model = type(start)(**truth)
    predictor = Predictor(train.time_step, Substeps(RungeKutta(RK4), 4))
    guess = {key: np.full(60, float(name == "lotka_volterra")) for key in model.unmeasured}
    for run in (train, test):
        guessed = replace(run, channels={**run.channels, **guess})
        free = compare(predictor, model, guessed, free=model.states)
        gap = np.std(free.measured - free.free_run)
        assert 0.5 < gap / simulated_sets.NOISE[name] < 1.3


@pytest.mark.parametrize("name", output_sets.SETS)
def test_a_set_of_outputs_follows_its_model_with_the_true_parameters(name):
    start, runs, truth = output_sets.SETS[name](150)
    assert truth.keys() == vars(start).keys()
    assert len(runs) == 2 + (name == "two_rates")
    for run in runs:
        predictor = Predictor(run.time_step, Substeps(RungeKutta(RK4), 4))
        free = compare(predictor, type(start)(**truth), run)
        noise = [*output_sets.NOISE[name].values()]
        gap = np.std(free.measured - free.free_run, axis=0) / noise
        assert ((gap > 0.5) & (gap < 1.3)).all()


def test_a_set_written_with_outputs_has_the_same_errors():
    start, (train, _), truth = simulated_sets.two_mass(400)
    known = type(start)(**truth)
    other = output_sets.with_outputs(known)
    assert (dict(other.outputs), other.unmeasured) == ({"motor": "rad/s"}, ())
    runs = [compare(Predictor(1e-3), model, train, free=start.states) for model in (known, other)]
    errors = [np.std(run.measured - run.free_run) for run in runs]
    assert errors == pytest.approx([simulated_sets.NOISE["two_mass"]] * 2, rel=0.1)


def test_simulated_sets_draw_their_noise_anew_and_count_what_covers(monkeypatch, capsys):
    (_, (one, _), truth), (_, (other, _), _) = (simulated_sets.lotka_volterra(9, k) for k in (0, 1))
    gap = np.abs(one.channels["prey"] - other.channels["prey"])
    assert 0 < gap.max() < 8 * simulated_sets.NOISE["lotka_volterra"]
    errors = {"birth": 0.0, "death": 1.9, "growth": -2.1}  # deviations
    found = {key: Estimate.of(truth[key] + 0.01 * e, 0.01, "1/s") for key, e in errors.items()}
    horizon = SimpleNamespace(selected=7, verdict="plateau")
    fit = SimpleNamespace(parameters=found, horizon=horizon)
    monkeypatch.setattr(simulated_sets, "identify", lambda start, experiments: fit)
    simulated_sets.main(["lotka_volterra"], 2)
    assert capsys.readouterr().out.splitlines()[-1] == "lotka_volterra: 4 of 6 intervals cover"


def test_drawn_operating_points_balance_and_are_identified(capsys):
    bench = operating_points.drawn(3)
    u, i = (bench.columns[f"{n}_d"] + 1j * bench.columns[f"{n}_q"] for n in "ui")
    shaft = bench.columns["torque"] * bench.columns["omega_el"] / bench.pole_pairs
    lost = 1.5 * np.real(np.conj(i) * u) - shaft
    assert np.mean(lost > 0) > 0.9
    one = operating_points.identified(bench, torque=True, command=False)
    assert one.verdict in {ANSWERED, "not identifiable"}
    monkey = operating_points.Outcome(ANSWERED, True, False, 0.2, -0.1)
    operating_points.print_table({True: [monkey], False: [monkey]})
    assert "1 of 1 positive" in capsys.readouterr().out


def test_an_error_of_public_sets_counts_the_channels_that_have_a_unit():
    gap = np.stack([np.full(4, 3e-3), np.full(4, 7.0)], axis=1)
    assert public_sets.scaled_errors((1e-3, 0.0), gap) == pytest.approx([3.0])


def test_recordings_as_they_are_have_outliers_and_a_table(capsys):
    run = recordings_as_they_are.recorded("run", 0.02, 400, 1)
    model, free = recordings_as_they_are.Pendulum(**recordings_as_they_are.TRUTH), ("angle", "rate")
    predictor = Predictor(run.time_step, Substeps(RungeKutta(RK4), 4))
    seen = compare(predictor, model, run, free=free)
    assert seen.free_run_rmse == pytest.approx(recordings_as_they_are.NOISE, rel=0.2)
    bad = recordings_as_they_are.with_outliers(run, 1).channels["angle"]
    off = np.flatnonzero(bad != run.channels["angle"])
    assert 2 <= len(off) <= 20
    found = {key: Estimate.of(one, 0.01, "1/s") for key, one in vars(model).items()}
    fit = SimpleNamespace(parameters=found, horizon=SimpleNamespace(verdict="plateau"))
    recordings_as_they_are.print_table({"a case": [fit, fit]})
    assert "1.00, damping 1.00; covered 4 of 4; plateau 2 of 2" in capsys.readouterr().out


@pytest.mark.parametrize("name", noise_models.CASES)
def test_models_with_noise_are_simulated_as_they_are_written(name, capsys):
    case = noise_models.CASES[name]
    model, random = case.model(**case.truth), np.random.default_rng(2)
    x, u = random.normal(size=2), random.normal(size=(1, 1))
    by_hand = noise_models._rate(model, x, u)
    np.testing.assert_allclose(rates(model, x[:, None], u)[:, 0], by_hand, rtol=1e-12)
    with float64():
        read = np.asarray(model.output(x[:, None], Inputs(u, model.inputs)))
    np.testing.assert_allclose(read[:, 0], noise_models._output(model, x, u), rtol=1e-12)
    quiet = replace(
        case, process=(0.0, 0.0), white=(0.0,) * len(read), correlated=(0.0,) * len(read)
    )
    still, noisy = noise_models.recorded(quiet, 1), noise_models.recorded(case, 1)
    predictor = Predictor(case.step, Substeps(RungeKutta(RK4), 8))
    seen = compare(predictor, model, still)
    assert seen.free_run_rmse < 0.02 * np.std(seen.measured)
    assert compare(predictor, model, noisy).free_run_rmse > 3 * seen.free_run_rmse
    one = {"verdict": "plateau", "std": [1.0] * len(case.truth), "objections": []}
    one |= {"error": [0.0] * len(case.truth), "covered": [True] * len(case.truth)}
    noise_models.print_table(name, [{"alone": one, "noise model": one}])
    assert f"{name}, noise model: 1 of 1 positive" in capsys.readouterr().out
