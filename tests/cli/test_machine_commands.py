"""export, loci, compare, and simulate with the identified machine, from the command line."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from penode.bench.config import load_config
from penode.cli.loci import _end_of, _figures
from penode.data.save import save
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.pmsm.control.loci import Locus, supported_torques
from penode.pmsm.exports.formats import FORMATS
from penode.pmsm.result_files import flux_map_csv
from penode.pmsm.simulation.simulated_drive import deviation


@pytest.fixture
def result(machine_fit, tmp_path):
    """Return a folder with a saved fit and its map."""
    folder = tmp_path / "result"
    machine_fit.save(folder)
    write_atomically(folder / "flux_map.csv", flux_map_csv(machine_fit))
    return folder


@pytest.mark.parametrize("to", list(FORMATS))
def test_every_format_is_written(result, penode, tmp_path, to):
    out = tmp_path / "new" / f"map{FORMATS[to].suffix}"
    done = penode("export", result, "--to", to, "--out", out)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert str(out) in done.stdout.replace("\n", "")
    assert "(replaced)" not in done.stdout
    assert out.stat().st_size > 1000
    told = "linear interpolation is within" in " ".join(done.stdout.split())
    assert told == (to not in ("csv", "onnx"))
    assert ("mtpa" in done.stdout) == (to in ("c", "c_fixed", "mat", "m", "xlsx"))


def test_an_export_without_pole_pairs_says_what_it_leaves_out(machine_fit, penode, tmp_path):
    known = {k: v for k, v in machine_fit.provenance.items() if k != "pole_pairs"}
    replace(machine_fit, provenance=known).save(tmp_path / "result")
    asked = ("export", tmp_path / "result", "--to", "c", "--out", tmp_path / "machine.h")
    assert "left out, as is the torque" in " ".join(penode(*asked).stdout.split())
    assert "left out" not in penode(*asked, "--pole-pairs", 5).stdout


def test_an_export_says_that_it_replaced_a_file(result, penode, tmp_path):
    out = tmp_path / "map.csv"
    out.write_text("another map")
    done = penode("export", result, "--to", "csv", "--out", out)
    assert "(replaced)" in done.stdout
    assert "another map" not in out.read_text()


def test_points_are_taken_and_pole_pairs_are_those_of_the_fit(result, penode, tmp_path):
    out = tmp_path / "map.npz"
    asked = ("export", result, "--to", "npz", "--out", out, "--points", 9)
    for wrong in ((*asked, "--pole-pairs", 3), ("loci", result, "--pole-pairs", 3)):
        done = penode(*wrong)
        assert done.returncode == 2
        assert "pole pairs must be 5, as the fit was identified with, got 3" in done.stderr
    assert not out.exists()
    done = penode(*asked, "--pole-pairs", 5)
    assert done.returncode == 0, done.stderr
    assert "9 x 9" in done.stdout
    with np.load(out) as arrays:
        assert arrays["n_p"] == 5


def test_every_range_of_torque_that_recordings_support_is_said():
    supported = np.array([1, 1, 0, 1, 1, 0], dtype=bool)
    torque = np.array([0.0, 20.0, 40.0, 60.0, 100.0, 120.0])
    assert supported_torques(torque, supported) == "0 to 20 and 60 to 100"
    assert supported_torques(torque, ~supported & supported) == "none"


@pytest.mark.parametrize(("largest", "said"), [(100.0, "100 A"), (50.0, "more than 75.0 A")])
def test_a_characteristic_current_far_beyond_the_recordings_is_no_number(largest, said):
    point = np.array([[-100.0], [0.0]])
    locus = Locus(point, point, np.zeros(1), np.ones(1, bool))
    loci = SimpleNamespace(
        characteristic=locus, mtpa=locus, mtpv=locus, over_speed=None, base_speed=None
    )
    assert dict(_figures(loci, largest))["characteristic current"] == said


@pytest.mark.parametrize(
    ("supported", "words"),
    [
        ([True, True], ""),
        ([True, False], "; motoring, recordings support 0 to 0 Nm"),
        ([False, False], ", beyond the recordings"),
    ],
)
def test_the_end_of_a_locus_is_told_with_what_recordings_support(supported, words):
    currents = np.array([[0.0, -60.0], [0.0, 80.0]])
    locus = Locus(currents, currents, np.array([0.0, 30.0]), np.array(supported))
    assert _end_of(locus) == f"30.0 Nm at i_d −60.0 A, i_q 80.0 A{words}"


def test_loci_are_told_drawn_and_tabulated(result, penode, tmp_path):
    out, table = tmp_path / "loci.png", tmp_path / "loci.csv"
    done = penode("loci", result, "--i-max", 240, "--u-max", 120, "--out", out, "--csv", table)
    assert done.returncode == 0, done.stderr
    for word in ("MTPA", "Nm at i_d", "MTPV", "characteristic", "base speed", "rpm"):
        assert word in done.stdout
    assert out.read_bytes().startswith(b"\x89PNG")
    assert table.read_text().startswith("locus,i_d")


def test_a_report_against_a_second_map(result, penode, tmp_path):
    done = penode("report", result, "--against", result / "flux_map.csv")
    assert done.returncode == 0, done.stderr
    assert "Against another map" in (result / "report.html").read_text()
    (result / "report.html").unlink()
    done = penode("report", result, "--against", tmp_path / "none.csv")
    assert done.returncode == 2
    (tmp_path / "machine.mat").write_bytes(b"MATLAB")
    done = penode("report", result, "--against", tmp_path / "machine.mat")
    assert done.returncode == 2
    assert "--against must be a CSV such as flux_map.csv or the folder" in done.stderr
    assert not (result / "report.html").exists()


@pytest.mark.slow
def test_currents_over_torque_and_speed_are_tabulated(result, machine_fit, penode, tmp_path):
    table = tmp_path / "points.csv"
    axes = ("--torque", "0:60:4", "--speed", "-3000:3000:3")
    done = penode("loci", result, "--i-max", 200, "--u-max", 120, "--table", table, *axes)
    assert done.returncode == 0, done.stderr
    assert "12 of 12 points reached, 12 of them supported" in done.stdout
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:3, 1], [-3000, 0, 3000])
    torque = 7.5 * (rows[:, 4] * rows[:, 3] - rows[:, 5] * rows[:, 2])
    np.testing.assert_allclose(torque, np.repeat([0, 20, 40, 60], 3), atol=1e-5)
    usual = penode("loci", result, "--i-max", 200, "--u-max", 120, "--table", table, "--json")
    assert usual.returncode == 0, usual.stderr
    speeds = np.unique(np.genfromtxt(table, delimiter=",", skip_header=1)[:, 1])
    step = float(f"{json.loads(usual.stdout)['base_speed_rpm'] / 10:.1e}")  # two digits
    np.testing.assert_allclose(speeds, step * np.arange(21), rtol=1e-8)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--table", "t.csv"), "a voltage limit must be known"),
        (("--torque", "0:9:3"), "must be given with --table"),
        (("--u-max", 120, "--table", "t.csv", "--speed", "0:x:3"), "got '0:x:3'"),
        (("--u-max", 120, "--table", "t.csv", "--speed", "9:0:3"), "got '9:0:3'"),
    ],
)
def test_tables_that_cannot_be_are_refused(result, penode, options, words):
    done = penode("loci", result, *options)
    assert done.returncode == 2
    assert words in done.stderr
    assert not (result.parent / "t.csv").exists()


def test_compare_with_a_fit_and_with_a_file(result, machine_fit, penode, tmp_path):
    other = tmp_path / "other"
    machine_fit.save(other)
    out = tmp_path / "difference.png"
    done = penode("compare", result, other, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "they agree" in done.stdout
    assert "psi differs by" in done.stdout
    done = penode("compare", result, result / "flux_map.csv", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "R " not in done.stdout
    assert out.read_bytes().startswith(b"\x89PNG")
    turned = penode("compare", result / "flux_map.csv", result)
    assert turned.returncode == 2
    assert "a map must be given second" in turned.stderr
    absent = penode("compare", result, tmp_path / "none.csv")
    assert absent.returncode == 2
    assert "there is no such file" in absent.stderr
    alone = penode("compare", result, other)
    assert alone.returncode == 0, alone.stderr
    assert "picture" not in alone.stdout


def test_loci_and_differences_for_a_program(result, machine_fit, penode, tmp_path):
    out = tmp_path / "picture.png"
    done = penode("loci", result, "--i-max", 240, "--u-max", 120, "--out", out, "--json")
    found = json.loads(done.stdout)
    end = found["mtpa"]
    assert np.hypot(end["i_d"], end["i_q"]) == pytest.approx(240, rel=1e-6)
    psi_d, psi_q = machine_fit.flux_map(end["i_d"], end["i_q"])
    expected = 7.5 * (psi_d * end["i_q"] - psi_q * end["i_d"])
    assert end["torque"] == pytest.approx(expected, rel=1e-6)
    assert found["base_speed_rpm"] > 0
    done = penode("compare", result, result / "flux_map.csv", "--out", out, "--json")
    found = json.loads(done.stdout)
    assert found["psi_rms"] <= found["psi_largest"] < 1e-8
    assert found["resistance"] is None
    assert found["picture"] == str(out)


DRIVE = """
duration = 0.03
speed_rpm = 900.0
machine = { result = "result" }
reference = { kind = "steps", points = [[0.0, 0.0], [-60.0, 120.0]], dwell = 0.02 }
"""


def drive(penode, folder, text, *options):
    (folder / "drive.toml").write_text(text)
    return penode("simulate", folder / "drive.toml", "--out", folder / "drive.csv", *options)


def test_a_map_of_another_result_is_not_driven(result, machine_fit, penode, tmp_path):
    made = machine_fit.files(beside={"flux_map.csv": b"the map of another"})
    (result / "result.json").write_bytes(made["result.json"])
    done = drive(penode, tmp_path, DRIVE)
    assert done.returncode == 2
    assert f"{result}/flux_map.csv: not the file that result.json beside it" in done.stderr
    assert not (tmp_path / "drive.csv").exists()


def test_the_identified_machine_is_driven_and_drawn(result, machine_fit, penode, tmp_path):
    done = drive(penode, tmp_path, DRIVE, "--over-time", tmp_path / "drive.png")
    assert done.returncode == 0, done.stderr
    assert done.stderr == "", "all of it lies where recordings have been"
    assert "of result at 900 rpm" in done.stdout
    assert (tmp_path / "drive.png").read_bytes().startswith(b"\x89PNG")
    truth = json.loads((tmp_path / "drive.truth.json").read_text())
    assert truth["resistance"] == machine_fit.parameters["R"].value
    # At the end of the second step the voltages are R i + omega J psi of the fit.
    _, u_d, u_q, i_d, i_q, omega, _ = np.loadtxt(tmp_path / "drive.csv", delimiter=",", skiprows=1)[
        -1
    ]
    assert (i_d, i_q) == pytest.approx((-60.0, 120.0), abs=1.0)
    psi_d, psi_q = machine_fit.flux_map(i_d, i_q)
    assert u_d == pytest.approx(0.01 * i_d - omega * psi_q, abs=0.5)
    assert u_q == pytest.approx(0.01 * i_q + omega * psi_d, abs=0.5)


def test_leaving_the_recorded_currents_is_told(result, penode, tmp_path):
    done = drive(penode, tmp_path, DRIVE.replace("-60.0, 120.0", "200.0, 100.0"))
    assert done.returncode == 0, done.stderr
    assert "where no recording has been" in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"result"', '"gone"', ["machine.result", "gone", "correct the path"]),
        ('"result"', "7", ["result", "7", "a table with map or result"]),
        ('result = "result"', 'result = "result", map = "a.csv"', ["a table with map or result"]),
        ('result = "result"', 'result = "."', ["result.json", "penode identify"]),
        ('"result"', '"result", inductance_d = -1e-4', ["inductance_d", "> 0"]),
        ('"result"', '"result", poles = 4', ["poles", "pole_pairs"]),
    ],
)
def test_no_machine_gets_one_sentence(result, penode, tmp_path, old, new, words):
    done = drive(penode, tmp_path, DRIVE.replace(old, new))
    assert done.returncode == 2
    assert done.stderr.strip().count("\n") == 0, done.stderr
    for word in words:
        assert word in done.stderr
    assert not (tmp_path / "drive.csv").exists()


def test_what_the_result_does_not_know_is_asked_for(machine_fit, penode, tmp_path):
    untold = replace(machine_fit, provenance={}, parameters={})
    untold.save(tmp_path / "result")
    write_atomically(tmp_path / "result" / "flux_map.csv", flux_map_csv(machine_fit))
    done = drive(penode, tmp_path, DRIVE)
    assert "add pole_pairs" in done.stderr
    told = DRIVE.replace('"result" }', '"result", pole_pairs = 5 }')
    done = drive(penode, tmp_path, told)
    assert "add resistance" in done.stderr
    assert done.returncode == 2


def test_a_simulation_is_held_against_a_recording_of_the_same_kind_only(result, penode, tmp_path):
    (tmp_path / "drive.toml").write_text(DRIVE)
    run = load_config(tmp_path / "drive.toml").record()
    recorded, channels = tmp_path / "recorded.csv", run.experiment.channels
    save(replace(run.experiment, channels={**channels, "u_q": channels["u_q"] + 2.0}), recorded)
    done = drive(penode, tmp_path, DRIVE, "--against", recorded)
    assert "i_d 0.00 A, i_q 0.00 A rms from recorded.csv, after 10.0 ms" in done.stdout
    assert "u_d 0.00 V, u_q 2.00 V rms from it" in done.stdout
    faster = {**channels, "omega_el": channels["omega_el"] * 1.1}
    short = {name: values[:50] for name, values in channels.items()}
    for change, word in (
        ({"channels": faster}, "simulate at the speed of the recording"),
        ({"time_step": 2e-4}, "set time_step"),
        ({"channels": short}, "simulate for longer"),
    ):
        with pytest.raises(InputError, match=word):
            deviation(run, replace(run.experiment, **change))
    done = drive(penode, tmp_path, DRIVE, "--study", "study.toml")
    assert "--study needs --against" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("export", "{}", "--to", "fmu", "--out", "map.fmu"), "must be one of csv"),
        (("export", "{}", "--to", "c", "--out", "map.c"), "must be '.h'"),
        (("export", "absent", "--to", "c", "--out", "map.h"), "no such file"),
        (("loci", "{}", "--i-max", "-5", "--out", "loci.png"), "must be > 0 A"),
        (("loci", "{}", "--i-max", "1000"), "1.5 times the largest current that was recorded"),
        (("loci", "{}", "--i-max", "5", "--out", "loci.pdf"), "use .png"),
        (("loci", "{}", "--i-max", "5", "--out", "a.png", "--csv", "a.txt"), "use .csv"),
        (("compare", "{}", "absent.csv", "--out", "a.png"), "there is no such file"),
        (("compare", "{}", "{}", "--out", "a.svg"), "use .png"),
    ],
)
def test_unusable_input_gets_one_sentence(result, penode, monkeypatch, tmp_path, arguments, word):
    monkeypatch.chdir(tmp_path)
    done = penode(*(one.format(result) for one in arguments))
    assert done.returncode == 2
    assert done.stderr.strip().count("\n") == 0, done.stderr
    assert word in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_a_fit_of_no_machine_is_refused(oscillator, penode, tmp_path):
    oscillator.fit.save(tmp_path / "mass")
    done = penode("export", tmp_path / "mass", "--to", "c", "--out", tmp_path / "map.h")
    assert done.returncode == 2
    assert "spring" in done.stderr


def test_a_fit_without_answer_is_exported_with_exit_status_1(machine_fit, penode, tmp_path):
    lost = replace(machine_fit, horizon=replace(machine_fit.horizon, verdict="no plateau"))
    lost.save(tmp_path / "lost")
    out = tmp_path / "map.h"
    done = penode("export", tmp_path / "lost", "--to", "c", "--out", out)
    assert done.returncode == 1
    assert "no plateau" in done.stderr
    assert "RESISTANCE" not in out.read_text()


WANTED = {
    "report": (),
    "export": ("--to", "csv", "--out", "map.csv"),
    "loci": ("--i-max", 240, "--out", "loci.png"),
}


@pytest.mark.parametrize("command", [*WANTED, "compare", "compare with"])
def test_a_recording_where_a_result_is_wanted_is_refused_with_what_to_type(
    command, result, penode, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.csv").write_text("t,i_d,i_q\n0,1,2\n")
    (tmp_path / "run.parquet").write_bytes(b"PAR1")
    given = {
        "compare": ("compare", "run.csv", result, "--out", "difference.png"),
        "compare with": ("compare", result, "run.parquet", "--out", "difference.png"),
    }
    done = penode(*given.get(command, (command, "run.csv", *WANTED.get(command, ()))))
    assert done.returncode == 2
    file = "run.parquet" if command == "compare with" else "run.csv"
    sentence = " ".join(done.stderr.split())
    assert f"{file}: this is a file where the folder of a result was wanted" in sentence
    assert f"`penode identify {file} --out run`, with --config where it has" in sentence


def test_a_study_file_where_a_result_is_wanted_is_no_recording(penode, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text("pole_pairs = 5\n")
    done = penode("loci", "study.toml")
    assert done.returncode == 2
    assert "wanted; give the one that `penode identify --out` wrote." in " ".join(
        done.stderr.split()
    )


def test_a_flux_map_where_a_recording_is_wanted_is_named(result, penode):
    done = penode("check", result / "flux_map.csv")
    assert done.returncode == 2
    assert "this is a flux map or loci, with columns psi_d and psi_q; give the" in done.stderr


@pytest.mark.parametrize("name", ["result.json", "flux_map.csv", "fit/fit.json"])
def test_a_file_of_a_result_is_refused_with_its_folder(name, result, penode):
    done = penode("report", result / name)
    assert done.returncode == 2
    assert f"give the folder, {result}." in " ".join(done.stderr.split())
    assert "penode identify" not in done.stderr


def test_a_recording_where_a_map_is_wanted_is_refused(result, penode, tmp_path):
    (tmp_path / "run.csv").write_text("t,i_d,i_q\n0,1,2\n")
    done = penode("compare", result, tmp_path / "run.csv", "--out", tmp_path / "difference.png")
    assert done.returncode == 2
    assert "A recording has none yet: identify it" in " ".join(done.stderr.split())
