"""From a file with foreign names to a result: init, then identify with what it wrote."""

import json
import re
import tomllib

import numpy as np
import polars as pl
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal
from scipy.io import savemat
from tests.pmsm.injection import injected

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.save import save
from penode.fit.fit import Fit
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.study_file import load_study

pytestmark = pytest.mark.usefixtures("quickly_compiled")

POLE_PAIRS = 5


@pytest.fixture(scope="module")
def run():
    return simulate(TRACTION_300A, Lissajous(200.0, 140.0, 150.0), speed_rpm=900.0, duration=0.1)


def time_of(run):
    return np.arange(len(run)) * run.time_step


def rpm(run):
    return run.channels["omega_el"] / POLE_PAIRS * 30 / np.pi


# --- files as they come from four benches --------------------------------------------------------


def small_units(run, folder):
    """Times in ms, currents in mA, voltages in kV, the columns in an order of their own."""
    path, c = folder / "bench.parquet", run.channels
    columns = {
        "time_ms": time_of(run) * 1e3,
        "Iq_mA": c["i_q"] * 1e3,
        "Id_mA": c["i_d"] * 1e3,
        "Ud_kV": c["u_d"] / 1e3,
        "Uq_kV": c["u_q"] / 1e3,
        "n_rpm": rpm(run),
        "theta_deg": np.degrees(c["theta_el"]),
    }
    pl.DataFrame(columns).write_parquet(path)
    return path


def rapid_control(run, folder):
    """Paths of signals with their units, German, decimal commas."""
    path, c = folder / "messung.csv", run.channels
    columns = {
        "Zeit [s]": time_of(run),
        "Stromregler/i_d_ist [A]": c["i_d"],
        "Stromregler/i_q_ist [A]": c["i_q"],
        "Stromregler/u_d_soll [V]": c["u_d"],
        "Stromregler/u_q_soll [V]": c["u_q"],
        "Drehzahl_mech [1/min]": rpm(run),
        "phi_el [rad]": c["theta_el"],
        "T_Wicklung [°C]": 20 + time_of(run),
    }
    table = np.stack(list(columns.values()), axis=1).tolist()
    rows = [";".join(repr(x).replace(".", ",") for x in row) for row in table]
    path.write_text("\n".join([";".join(columns), *rows]) + "\n")
    return path


def control_unit(run, folder):
    """Currents in rms, and a slow group for the shaft's speed."""
    path, c, fast = folder / "ecu.mf4", run.channels, time_of(run)
    slow = slice(None, None, 27)  # the last sample of both is one
    rms = np.sqrt(2)
    quick = {
        "Id_A": (c["i_d"] / rms, "A"),
        "Iq_A": (c["i_q"] / rms, "A"),
        "Ud_V": (c["u_d"], "V"),
        "Uq_V": (c["u_q"], "V"),
        "ThetaEl_deg": (np.degrees(c["theta_el"]), "deg"),
    }
    lazy = {
        "nMot_rpm": (rpm(run)[slow], "rpm"),
        "Udc_V": (np.full(len(fast[slow]), 400.0), "V"),
        "TempStator_C": (20 + fast[slow], "°C"),
    }
    with MDF(version="4.10") as file:
        for group, times in ((quick, fast), (lazy, fast[slow])):
            file.append([MdfSignal(v, times, unit=u, name=n) for n, (v, u) in group.items()])
        file.save(path, overwrite=True)
    return path


def logged_signals(run, folder):
    """A structure with time: phases, the shaft's angle and speed, no units anywhere."""
    path, c = folder / "logsout.mat", run.channels
    currents, voltages = (
        abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), c["theta_el"]) for kind in "iu"
    )
    shaft = np.mod(np.unwrap(c["theta_el"]) / POLE_PAIRS, 2 * np.pi)
    speed, time = c["omega_el"] / POLE_PAIRS, time_of(run)[:, None]
    named = {"i_abc": currents, "v_abc": voltages, "theta_m": shaft[:, None], "wm": speed[:, None]}
    signals = np.zeros(len(named), dtype=[("values", object), ("label", object)])
    for place, (label, values) in enumerate(named.items()):
        signals[place] = (values, label)
    savemat(path, {"logsout": {"time": time, "signals": signals}, "tout": time})
    return path


FILES = {
    "rapid control": rapid_control,
    "control unit": control_unit,
    "logged signals": logged_signals,
}


@pytest.fixture(scope="module")
def results(run, tmp_path_factory):
    """Return a function that inits and identifies one of the files, once."""
    known = {}

    def find(kind, penode):
        if kind not in known:
            folder = tmp_path_factory.mktemp("bench")
            recording, config = FILES[kind](run, folder), folder / "study.toml"
            told = penode("init", recording, "--out", config)
            assert told.returncode == 0, told.stderr
            study = config.read_text()
            options = ("--horizon", 1, "--no-inverter", "--angle-orders", "none", "--json")
            out = folder / "out"
            done = penode("identify", recording, "--config", config, *options, "--out", out)
            assert done.returncode == 0, done.stderr
            assert config.read_text() == study, "untouched"
            assert Fit.load(out).provenance["study_file"] == tomllib.loads(study)
            result = json.loads(done.stdout)
            assert result == json.loads((out / "result.json").read_text())
            known[kind] = told.stdout, study, result
        return known[kind]

    return find


#: Of these two the results are compared as well.
QUICK = ("rapid control", "logged signals")


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=() if k in QUICK else pytest.mark.slow) for k in FILES]
)
def test_what_init_writes_works_untouched(kind, results, penode):
    told, study, result = results(kind, penode)
    assert "All of this is guessed" in told
    assert "mechanical" in told
    assert result["horizon"]["selected"] == 1  # the option, not the file's auto
    assert result["provenance"]["pole_pairs"] == POLE_PAIRS
    # Nobody can tell currents in rms: they are taken for peak values, and the file says so.
    factor = np.sqrt(2) if kind == "control unit" else 1.0
    assert study.count("peak, as no file shows it") == (0 if kind == "logged signals" else 4)
    assert result["parameters"]["R"]["value"] == pytest.approx(0.01 * factor, rel=0.2)


def test_two_files_of_one_recording_give_the_same_numbers(results, penode):
    """dq quantities as text with decimal commas, and phases in binary."""
    (*_, one), (*_, other) = (results(kind, penode) for kind in ("rapid control", "logged signals"))
    one, other = (
        {
            **r["parameters"]["R"],
            **r["horizon"]["ladder"][0],
            **next(iter(r["metrics"]["train"].values())),
        }
        for r in (one, other)
    )
    assert other["value"] == pytest.approx(one["value"], rel=1e-9)
    # Rounding of the units grows with the condition of the map: to 4e-9 in R's deviation.
    for name in ("std", "interval_95", "identifiability", "rmse", "free_run_rmse_A"):
        assert other[name] == pytest.approx(one[name], rel=1e-8), name


@pytest.fixture
def recording(run, tmp_path):
    return small_units(run, tmp_path)


def test_init_never_overwrites(recording, penode, tmp_path):
    config = tmp_path / "study.toml"
    config.write_text("mine")
    done = penode("init", recording, "--out", config)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "study.toml: this file exists" in done.stderr
    wrong = penode("init", tmp_path / "recordnig.csv", "--out", config)
    assert "recordnig.csv: file not found" in " ".join(wrong.stderr.split())
    assert config.read_text() == "mine"


def test_init_says_what_it_could_not_find(penode, tmp_path):
    run, config = tmp_path / "run.csv", tmp_path / "study.toml"
    rows = "".join(f"{k / 1e3},{k},{k},900,7\n" for k in range(9))
    run.write_text(f"t,Id,Iq,n_mech,oil\n{rows}")
    done = penode("init", run, "--out", config)
    assert done.returncode == 0, done.stderr
    assert "Fill in before you use it: column of u_d, column of u_q, pole_pairs." in done.stdout
    assert re.search("^not used +oil$", done.stdout, re.MULTILINE)
    done = penode("identify", run, "--config", config, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "pole_pairs is missing" in done.stderr


def test_init_says_how_samples_that_are_counted_get_their_times(run, penode, tmp_path):
    """The line it writes, with its comment sign removed, makes a recording of the file."""
    save(run, tmp_path / "timed.csv")
    header, *rows = (tmp_path / "timed.csv").read_text().splitlines()
    counted, config = tmp_path / "run.csv", tmp_path / "study.toml"
    lines = [f"{k},{row.split(',', 1)[1]}" for k, row in enumerate(rows)]
    counted.write_text("\n".join([header.replace("t,", "SampleNo,", 1), *lines]))
    done = penode("init", counted, "--out", config)
    assert "Fill in before you use it: time_step (SampleNo counts samples)" in " ".join(
        done.stdout.split()
    )
    config.write_text(config.read_text().replace("# time_step =", "time_step ="))
    run_again = load_study(config).load(counted)
    assert run_again.time_step == pytest.approx(1e-4)
    assert len(run_again) == len(run)


def test_init_says_of_rounded_times_that_their_step_is_wanted(run, penode, tmp_path):
    rounded = np.floor(1e3 * time_of(run) + 1e-6) / 1e3
    columns = {"t": rounded, **run.channels}
    path, config = tmp_path / "rounded.csv", tmp_path / "study.toml"
    np.savetxt(
        path,
        np.column_stack([*columns.values()]),
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    done = penode("init", path, "--out", config)
    assert "time_step (t jitters or repeats)" in " ".join(done.stdout.split())
    config.write_text(config.read_text().replace("# time_step =", "time_step ="))
    read = load_study(config).load(path)
    assert read.time_step == pytest.approx(1e-4, rel=1e-6)
    assert len(read) == len(run)


def test_init_refuses_what_cannot_be_read_and_leaves_nothing(penode, tmp_path):
    done = penode("init", tmp_path / "gone.csv", "--out", tmp_path / "study.toml")
    assert done.returncode == 2
    assert "gone.csv: file not found" in done.stderr
    assert not (tmp_path / "study.toml").exists()


def test_a_flux_map_is_no_recording(penode, tmp_path):
    table = tmp_path / "fem.csv"
    points = [f"{d},{q},{0.06 + 1e-3 * d},{2e-3 * q}" for d in range(9) for q in range(9)]
    table.write_text("\n".join(["i_d,i_q,psi_d,psi_q", *points]))
    done = penode("init", table, "--out", tmp_path / "study.toml")
    assert done.returncode == 2
    assert "got the table of a flux map; compare it" in done.stderr
    assert not (tmp_path / "study.toml").exists()


def test_a_recording_with_an_observers_flux_linkage_is_one(run, penode, tmp_path):
    save(run, tmp_path / "run.csv")
    header, *rows = (tmp_path / "run.csv").read_text().splitlines()
    lines = [f"{header},psi_d,psi_q", *(f"{row},0.06,{k}e-6" for k, row in enumerate(rows))]
    observed = tmp_path / "observed.csv"
    observed.write_text("\n".join(lines))
    done = penode("init", observed, "--out", tmp_path / "study.toml")
    assert done.returncode == 0, done.stderr
    assert "psi_d" in done.stdout


def test_identify_refuses_a_bad_study_file_in_one_sentence(recording, penode, tmp_path):
    config = tmp_path / "study.toml"
    config.write_text("horizn = 3\n")
    done = penode("identify", recording, "--config", config, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "did you mean horizon?" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def injection(folder):
    """A standstill test as a drive logs it: no column of speed."""
    run = injected("d", (130.0, 0.0), samples=200)
    columns = [run.channels[name] for name in ("u_d", "u_q", "i_d", "i_q")]
    table = np.column_stack([1e-4 * np.arange(200), *columns])
    path = folder / "d.csv"
    np.savetxt(path, table, delimiter=",", header="t,Ud,Uq,Id,Iq", comments="")
    return path


def test_a_rotor_that_stood_still_needs_no_column_of_speed(penode, tmp_path):
    recording, study = injection(tmp_path), tmp_path / "study.toml"
    done = penode("init", recording, "--out", study)
    assert "column of omega_el. Did the rotor stand still? Then add --standstill." in done.stdout
    study.unlink()
    done = penode("init", recording, "--standstill", "--out", study)
    assert done.returncode == 0, done.stderr
    assert "Fill in" not in done.stdout
    assert not load_study(study).load(recording).channels["omega_el"].any()


def test_a_speed_that_turns_contradicts_standstill(recording, penode, tmp_path):
    done = penode("init", recording, "--standstill", "--out", tmp_path / "study.toml")
    assert done.returncode == 2
    assert "the rotor must stand still for --standstill" in done.stderr
    assert not (tmp_path / "study.toml").exists()
