"""Tables of operating points through the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.pmsm.points.test_operating_points import PAIRS, R, measured
from validate.operating_points import flux

from penode import Experiment, Fit, InputError
from penode.bench.machines import TRACTION_300A, torque
from penode.data.save import save
from penode.pmsm import export, load_study
from penode.pmsm.points.operating_points import load_runs


def written(folder, points, **columns):
    """Write points as a CSV file, columns added or replaced."""
    every = {**points.channels, **columns}
    file = folder / "points.csv"
    rows = np.column_stack([np.broadcast_to(v, len(points)) for v in every.values()])
    np.savetxt(file, rows, "%.9g", ",", header=",".join(every), comments="")
    return file


def test_the_command_reads_a_table_and_writes_a_whole_result(tmp_path, penode):
    file, out = written(tmp_path, measured()), tmp_path / "out"
    ended = penode("identify", file, "--pole-pairs", PAIRS, "--out", out)
    assert ended.returncode == 0, ended.stderr
    assert "operating points" in ended.stdout
    assert "horizon" not in ended.stdout
    again = Fit.load(out)
    low, high = again.parameters["R"].interval_95
    assert low < R < high
    assert again.stationary.covered.keys() == {"u_d", "u_q", "torque"}
    metrics = json.loads((out / "result.json").read_text())["metrics"]
    assert metrics["stationary"]["points.csv"]["torque"]["unit"] == "Nm"
    page = (out / "report.html").read_text()
    assert "Points against the model" in page
    assert "This section is left out" not in page
    export(again, "c", tmp_path / "machine.h")


def test_a_table_is_read_by_the_first_study_file_that_fits_it(tmp_path, penode):
    text = written(tmp_path, measured()).read_text()
    names = text.split("\n")[0].split(",")
    own = {name: f"{name}_of_table" for name in names}
    file = tmp_path / "table.csv"
    file.write_text(text.replace(",".join(names), ",".join(own.values()), 1))
    for study, columns in (("bench", dict.fromkeys(names, "absent")), ("table", own)):
        lines = [f'{name} = "{column}"' for name, column in columns.items()]
        (tmp_path / f"{study}.toml").write_text("\n".join(["[channels]", *lines]))
    configs = [
        part for one in ("bench", "table") for part in ("--config", tmp_path / f"{one}.toml")
    ]
    ended = penode("check", file, *configs, "--pole-pairs", PAIRS)
    assert ended.returncode == 0, ended.stderr
    assert "operating points" in ended.stdout


@pytest.mark.slow
def test_points_beside_a_recording_narrow_its_answer(tmp_path, penode, slow_run):
    """Of the machine of the recording: its flux linkage at the recording's own currents."""
    save(slow_run, tmp_path / "run.csv")
    chosen = np.linspace(100, len(slow_run) - 100, 30).astype(int)
    i = slow_run.stack(("i_d", "i_q"))[chosen]
    psi_d, psi_q = flux(TRACTION_300A, i[:, 0] + 1j * i[:, 1]).view(float).reshape(-1, 2).T
    speed = np.where(np.arange(30) % 2, 100.0, 500.0)
    resistance = TRACTION_300A.resistance
    voltages = {
        "u_d": resistance * i[:, 0] - speed * psi_q,
        "u_q": resistance * i[:, 1] + speed * psi_d,
    }
    noise = 0.02 * np.random.default_rng(1).normal(size=(2, 30))
    voltages = {n: v + own for (n, v), own in zip(voltages.items(), noise, strict=True)}
    channels = {**voltages, "i_d": i[:, 0], "i_q": i[:, 1], "omega_el": speed}
    text = written(tmp_path, Experiment("points.csv", 1.0, channels)).read_text()
    file, config = tmp_path / "bench.csv", tmp_path / "bench.toml"
    file.write_text(text.replace("i_d", "Id", 1).replace("u_d", "Ud", 1))  # names of its own
    config.write_text('[channels]\ni_d = { column = "Id" }\nu_d = { column = "Ud" }\n')
    options = ("--horizon", 20, "--hold", "dq", "--no-inverter", "--angle-orders", "none")
    run, out = tmp_path / "run.csv", tmp_path / "out"
    beside = ("--points", file, "--points-config", config)
    ended = penode("identify", run, *beside, *options, "--out", out)
    assert ended.returncode == 0, ended.stderr
    assert "\npsi_PM " in ended.stdout
    again = Fit.load(out)
    low, high = again.parameters["R"].interval_95
    assert low < resistance < high
    assert "operating points" in [row.source for row in again.parameters["R"].budget]
    assert "30 operating points narrow R and the map" in (out / "result.json").read_text()
    page = (out / "report.html").read_text()
    assert "Points against the model" in page
    assert "This section is left out" not in page


def test_tables_of_one_machine_are_one(tmp_path):
    """Two sets of a winding, or a table a temperature; channels have to be those of the first."""
    whole, files = measured(count=30), []
    for k, rows in enumerate((slice(0, 12), slice(12, 30))):
        (tmp_path / str(k)).mkdir()
        part = {name: values[rows] for name, values in whole.channels.items()}
        files.append(written(tmp_path / str(k), Experiment("part", 1.0, part)))
    mapping = load_study(None).mapping
    _, points = load_runs(files, mapping)
    for name, values in whole.channels.items():
        np.testing.assert_allclose(points.channels[name], values, rtol=1e-8)
    assert points.name == "points.csv, points.csv"
    silent = {name: values for name, values in whole.channels.items() if name != "torque"}
    other = written(tmp_path, Experiment("part", 1.0, silent))
    with pytest.raises(
        InputError, match=r"must be those of points\.csv, got torque in one of them"
    ):
        load_runs([files[0], other], mapping)
    run = tmp_path / "run.csv"
    save(replace(whole, channels=silent), run)
    with pytest.raises(InputError, match=r"got it with run\.csv; beside recordings give it with"):
        load_runs([files[0], run], mapping)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("identify", "{file}", "{file}", "--out", "{out}"), "must be given once; remove a copy"),
        (("identify", "{file}", "--horizon", "5", "--out", "{out}"), "which has no horizon"),
        (("identify", "{file}", "--points", "{file}", "--out", "{out}"), "which has no horizon"),
        (("identify", "{file}", "--points-config", "{file}", "--out", "{out}"), "with --points"),
        (("check", "{file}"), f"pole_pairs is missing; add --pole-pairs ({PAIRS} would fit)"),
    ],
)
def test_the_command_refuses_what_points_are_not(tmp_path, penode, arguments, sentence):
    file = written(tmp_path, measured(count=12))
    places = {"file": file, "out": tmp_path / "out"}
    ended = penode(*(one.format(**places) for one in arguments))
    assert ended.returncode == 2
    assert sentence in ended.stderr


@pytest.mark.parametrize(
    ("points", "columns", "sentence"),
    [
        (measured(count=7), {}, "must be >= 8, got 7"),
        (measured(count=12), {"omega_el": 0.0}, "omega_el must differ from 0"),
    ],
)
def test_a_table_without_an_answer_is_refused(tmp_path, penode, points, columns, sentence):
    ended = penode("identify", written(tmp_path, points, **columns), "--out", tmp_path / "out")
    assert ended.returncode == 2
    assert sentence in ended.stderr


def test_a_recording_that_lost_its_time_is_no_table(tmp_path, penode):
    turn = np.linspace(0, 6, 400)
    points = measured(count=400)
    smooth = {"i_d": 80 * np.cos(turn) - 80, "i_q": 90 * np.sin(turn)}
    file = written(tmp_path, points, **smooth)
    ended = penode("identify", file, "--pole-pairs", PAIRS, "--out", tmp_path / "out")
    assert ended.returncode == 2
    assert "follow each other like samples" in ended.stderr
    assert not (tmp_path / "out" / "result.json").exists()


def test_the_command_checks_a_table(tmp_path, penode):
    file = written(tmp_path, measured(noise=0.3))
    ended = penode("check", file, "--pole-pairs", PAIRS)
    assert ended.returncode == 0, ended.stderr
    assert "40 operating points, with the torque" in ended.stdout
    assert "tenth of the speed" in ended.stdout
    found = json.loads(penode("check", file, "--pole-pairs", PAIRS, "--json").stdout)
    assert found["good"]
    assert found["points"] == 40
    refused = penode("check", file, "--pole-pairs", PAIRS, "--picture", tmp_path / "a.png")
    assert refused.returncode == 2
    assert "--picture must be left out" in refused.stderr


def test_columns_of_other_names_are_mapped_by_what_init_writes(tmp_path, penode):
    points = measured()
    names = {"u_d": "Ud (V)", "u_q": "Uq (V)", "i_d": "Id (A)", "i_q": "Iq (A)"}
    columns = {names.get(name, name): one for name, one in points.channels.items()}
    columns["n (rpm)"] = columns.pop("omega_el") * 30 / np.pi / PAIRS
    columns["M (mNm)"] = 1e3 * columns.pop("torque")
    file, study = tmp_path / "bench.csv", tmp_path / "study.toml"
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, "%.9g", ",", header=",".join(columns), comments="")
    told = penode("init", file, "--out", study)
    assert "table of operating points" in told.stdout
    assert "Fill in before you use it: pole_pairs." in " ".join(told.stdout.split())
    given = ("--config", study, "--pole-pairs", PAIRS, "--json")
    found = json.loads(penode("check", file, *given).stdout)
    own = written(tmp_path, points)
    same = json.loads(penode("check", own, "--pole-pairs", PAIRS, "--json").stdout)
    assert found["R_half_width"] == pytest.approx(same["R_half_width"], rel=1e-4)


def test_a_torque_in_a_recording_narrows_the_map(tmp_path, penode, slow_run):
    """That of the simulated machine itself; other options make it quick."""
    i_d, i_q, theta = (slow_run.channels[n] for n in ("i_d", "i_q", "theta_el"))
    channels = {**slow_run.channels, "torque": torque(TRACTION_300A, i_d, i_q, theta)}
    save(replace(slow_run, channels=channels), tmp_path / "run.csv")
    options = ("--horizon", 20, "--hold", "dq", "--no-inverter", "--angle-orders", "none")
    pairs = ("--pole-pairs", TRACTION_300A.pole_pairs)
    ended = penode("identify", tmp_path / "run.csv", *options, *pairs, "--out", tmp_path / "out")
    assert ended.returncode == 0, ended.stderr
    again = Fit.load(tmp_path / "out")
    assert again.stationary.covered["torque"] > 0.8
    assert "torque of the shaft" in [row.source for row in again.parameters["R"].budget]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "the torque of the shaft narrows the map" in page
    assert "This section is left out" not in page
