"""The first minutes: version, names as drives log them, what is missing, what is in the way."""

import io
import subprocess
import sys

import numpy as np
import pytest

import penode as package
from penode import InputError
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli import identify as command_line
from penode.data.load import load
from penode.data.readers import mat
from penode.data.save import save
from penode.pmsm.result_files import write
from penode.pmsm.study_file import load_study
from penode.validation.comparison import Comparison

HEAVY = {"matplotlib", "plotly", "h5py", "dask", "polars"}


@pytest.fixture(scope="module")
def run():
    return simulate(TRACTION_300A, Lissajous(200.0, 140.0, 150.0), speed_rpm=900.0, duration=0.1)


@pytest.fixture
def logged(run, tmp_path):
    """Return a recording under a drive's names; beside the dq channels the speed of the shaft."""
    c, step = run.channels, run.time_step
    columns = {
        "time": step * np.arange(len(run)),
        "idmeas": c["i_d"],
        "iqact": c["i_q"],
        "Udref": c["u_d"],
        "Uqref": c["u_q"],
        "nist": c["omega_el"] / 14 * 30 / np.pi,
        "TempMagnet": np.full(len(run), 61.5),
    }
    path = tmp_path / "logged.csv"
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path


def test_imports_load_no_library_that_draws_or_reads_tables():
    code = f"import sys, penode, penode.cli.main; sys.exit(len({HEAVY} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], timeout=120).returncode == 0


def test_version(penode, penode_process):
    said = f"penode {package.__version__}\n"
    for run_command in (penode, penode_process):
        done = run_command("--version")
        assert (done.returncode, done.stdout, done.stderr) == (0, said, "")
    assert "--version" in penode("--help").stdout
    as_module = subprocess.run(
        [sys.executable, "-m", "penode", "--version"], capture_output=True, text=True, timeout=120
    )
    assert (as_module.returncode, as_module.stdout) == (0, said)


def test_init_knows_a_drives_names_and_pole_pairs_may_come_with_the_command(
    logged, penode, tmp_path, run
):
    config = tmp_path / "study.toml"
    done = penode("init", logged, "--out", config)
    assert "Fill in before you use it: pole_pairs." in done.stdout
    for channel, column in (
        *(("i_d", "idmeas"), ("i_q", "iqact"), ("u_d", "Udref"), ("u_q", "Uqref")),
        *(("omega_el", "nist"), ("magnet_temperature", "TempMagnet")),
    ):
        assert f'\n{channel} = {{ column = "{column}"' in config.read_text()
    with pytest.raises(InputError, match="pole_pairs is missing"):
        load_study(config)
    asked = load_study(config, {"pole_pairs": 14})
    assert asked.study.pole_pairs == 14
    loaded = asked.load(logged)
    np.testing.assert_allclose(loaded.channels["omega_el"], run.channels["omega_el"], rtol=1e-9)
    np.testing.assert_array_equal(loaded.channels["magnet_temperature"], 61.5)


def test_pole_pairs_of_the_command_overrule_those_of_the_file(logged, penode, tmp_path):
    config = tmp_path / "study.toml"
    penode("init", logged, "--out", config)
    config.write_text(config.read_text().replace("# pole_pairs =", "pole_pairs = 7"))
    speeds = [
        load_study(config, given).load(logged).channels["omega_el"]
        for given in ({}, {"pole_pairs": 14})
    ]
    np.testing.assert_allclose(2 * speeds[0], speeds[1], rtol=1e-12)


@pytest.fixture
def identified(machine_fit, run, penode, monkeypatch, tmp_path):
    """Return the command over a recording with a training that is done."""
    save(run, tmp_path / "run.csv")
    asked = []

    def train(recordings, *, study, **_):
        asked.append(study)
        return machine_fit

    monkeypatch.setattr(command_line, "identify", train)

    def command(*options):
        return penode("identify", tmp_path / "run.csv", "--out", tmp_path / "out", *options)

    command.asked, command.out = asked, tmp_path / "out"
    return command


@pytest.mark.parametrize("browser", [True, False])
def test_open_shows_the_report(identified, monkeypatch, browser):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda page: opened.append(page) or browser)
    done = identified("--open", "--pole-pairs", 3)
    page = identified.out / "report.html"
    assert opened == [page.resolve().as_uri()]
    assert done.stderr == (
        "" if browser else f"note: no browser could be started; open {page} yourself.\n"
    )
    assert identified.asked[0].pole_pairs == 3


def test_a_finished_result_is_replaced_on_request_alone(identified):
    assert identified().returncode == 0
    before = (identified.out / "result.json").read_bytes()
    done = identified()
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"error: {identified.out} has a finished result: add --overwrite to replace it, or give "
        "another --out.\n"
    )
    assert (identified.out / "result.json").read_bytes() == before
    assert len(identified.asked) == 1
    assert identified("--overwrite").returncode == 0
    assert len(identified.asked) == 2


def test_the_demo_replaces_no_other_result(machine_fit, penode, tmp_path):
    machine_fit.save(tmp_path)
    done = penode("demo", "--out", tmp_path)
    assert done.returncode == 2
    assert (
        done.stderr
        == f"error: {tmp_path} has a result that is not the demo's: give another --out.\n"
    )


@pytest.mark.parametrize("command", ["check", "init", "identify"])
def test_the_folder_of_a_result_where_a_recording_is_wanted(command, machine_fit, penode, tmp_path):
    machine_fit.save(tmp_path / "result")
    out = ("--out", tmp_path / "out") if command != "check" else ()
    done = penode(command, tmp_path / "result", *out)
    assert done.returncode == 2
    assert "result: this is the folder of a result where a recording was wanted" in done.stderr


def test_loci_need_no_current_limit_and_no_picture(machine_fit, penode, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(machine_fit, tmp_path / "result")
    largest = np.hypot(*machine_fit.excited.T).max()
    done = penode("loci", tmp_path / "result", "--pole-pairs", 5)
    assert done.returncode == 0, done.stderr
    first, *rest = done.stdout.splitlines()
    assert first.startswith("current limit ")
    assert first.endswith(" A, as far as recordings back MTPA; --i-max gives another")
    assert float(first.split()[2]) == pytest.approx(largest, rel=0.01)
    said = " ".join(done.stdout.split())
    assert "voltage limit not known: torque over speed needs --u-max" in said
    assert "nothing is drawn or written without --out, --csv or --table" in said
    drawn = penode("loci", tmp_path / "result", "--pole-pairs", 5, "--u-max", 200, "--csv", "l.csv")
    assert "not known" not in drawn.stdout
    assert "nothing is drawn" not in drawn.stdout
    same = penode("loci", tmp_path / "result", "--pole-pairs", 5, "--i-max", repr(float(largest)))
    assert same.stdout.splitlines() == rest


@pytest.mark.parametrize(
    ("library", "extra", "typed"),
    [
        ("matplotlib", "plot", ("check", "run.csv", "--picture", "a.png")),
        ("matplotlib", "plot", ("loci", "result", "--out", "a.png")),
        ("matplotlib", "plot", ("compare", "result", "result", "--out", "a.png")),
        (
            "matplotlib",
            "plot",
            ("simulate", "well_designed", "--out", "a.csv", "--picture", "a.png"),
        ),
    ],
)
def test_a_missing_extra_is_named_with_its_command(
    library, extra, typed, penode, run, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    save(run, tmp_path / "run.csv")
    before = {path.name for path in tmp_path.iterdir()}
    monkeypatch.setitem(sys.modules, library, None)
    done = penode(*typed)
    assert done.returncode == 2
    assert (
        f" needs {library}, which is not installed: pip install 'penode[{extra}]'." in done.stderr
    )
    assert done.stderr.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == before


def test_the_extra_of_a_matlab_file_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(
        InputError, match=r"run.mat: a .* needs h5py, .*: pip install 'penode\[hdf5\]'"
    ):
        mat.read("run.mat", io.BytesIO(b"\x89HDF\r\n\x1a\n"))


def test_figures_of_a_fit_name_the_extra(machine_fit, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for asked in (machine_fit.plot_ladder, machine_fit.plot_map):
        with pytest.raises(InputError, match=r"penode\[plot\]"):
            asked()


def test_maps_are_listed_and_drawn_without_a_name(machine_fit):
    assert {"flux_map", "differential_inductance", "parameters"} <= set(dir(machine_fit))
    labels = [axes.get_ylabel() for axes in machine_fit.plot_map().axes]
    assert labels == [axes.get_ylabel() for axes in machine_fit.plot_map("flux_map").axes]


def test_what_needs_tables_of_polars_names_the_install(machine_fit, run, monkeypatch, tmp_path):
    """Text files, training and reports do without the library."""
    save(run, tmp_path / "run.parquet")
    monkeypatch.setitem(sys.modules, "polars", None)
    asks = (
        machine_fit.parameters_frame,
        machine_fit.correlation_frame,
        lambda: Comparison.to_frame(None),
        lambda: machine_fit.compare_models({"one": machine_fit}),
        lambda: save(run, tmp_path / "other.parquet"),
        lambda: load(tmp_path / "run.parquet"),
    )
    for ask in asks:
        with pytest.raises(InputError, match=r"needs polars, .*: pip install 'penode\[tables\]'"):
            ask()
    assert not list(tmp_path.glob("*other*"))
    save(run, tmp_path / "run.csv")
    back = load(tmp_path / "run.csv")
    for name, values in run.channels.items():
        np.testing.assert_array_equal(back.channels[name], values)
