"""A small case of every module of `benchmarks`: what makes docs/benchmarks.md runs."""

import ast
import importlib
import importlib.util
import pkgutil
import shutil
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import benchmarks
from benchmarks import (
    bench_speed,
    c_lookup,
    diffrax_gradient,
    fit_machines,
    gauss_newton,
    identification,
    long_recording,
    memory,
    operations,
    own_models,
    parallel_starts,
    peer_models,
    peers,
    problem,
    roofline,
    scale,
    start,
    sweep,
)
from benchmarks import run as all_benchmarks
from penode import Predictor
from penode.arrays import float64
from penode.data import gathered
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.pmsm.balance.start import nominal_start
from penode.pmsm.study_settings import Study
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import RK4_38
from penode.validation.free_run import compare
from validate import learned_sets, output_sets, public_sets, simulated_sets

#: Modules that need packages of an environment of their own.
ELSEWHERE = {
    "torch_problem": "torchdiffeq",
    "torchdiffeq_gradient": "torchdiffeq",
    "time_to_accuracy": "torchdiffeq",
    "jax_sysid_fit": "jax_sysid",
    "peer_casadi": "casadi",
    "peer_jax": "jax_sysid",
}
HERE = {
    "bench_speed", "c_lookup", "diffrax_gradient", "fit_machines", "gauss_newton",
    "identification", "long_recording", "memory", "operations", "own_models", "parallel_starts",
    "peer_models", "peers", "problem", "roofline", "run", "scale", "start",
    "sweep",
}  # fmt: skip
FOLDER = Path(benchmarks.__file__).parent
PEER_STARTS = {
    "tanks": learned_sets.Tanks(0.05, 0.05, 0.05, 0.05, 0.5),
    "silverbox": learned_sets.CubicSpring(1e5, 50.0, 2e5, 1e5, 0.01),
    "bouc_wen": learned_sets.Hysteresis(1.5, 5.0, 3e4, 3e4, 500.0, -500.0),
    "emps": learned_sets.Positioner(80.0, 150.0, 10.0, 1.0),
    "tclab": learned_sets.TemperatureLab(10.0, 0.01, 0.0075, 10.0),
    "rlc": learned_sets.Circuit(2.0, 300e-9, 60e-6, 0.8, 4.0, 2.0),
    "two_mass": simulated_sets.TwoMass(**simulated_sets.TWO_MASS),
    "van_de_vusse": simulated_sets.VanDeVusse(**simulated_sets.REACTOR),
    "lotka_volterra": simulated_sets.PredatorPrey(**simulated_sets.SPECIES),
    "wiener_hammerstein": output_sets.WienerHammerstein(**output_sets.FILTERS),
    "ship": output_sets.Ship(**output_sets.SHIP),
    "two_rates": output_sets.Servo(**output_sets.SERVO),
}


def test_every_module_has_a_case():
    """A new module of `benchmarks` joins HERE with a case below."""
    found = {one.name for one in pkgutil.iter_modules(benchmarks.__path__)}
    assert found == HERE | set(ELSEWHERE)


def test_recordings_of_own_models_are_those_of_the_parameters_they_are_said_to_have():
    """Where all states are measured, one step of the model errs by the noise of two samples."""
    _, run, (rate,) = own_models.lag(2_000)
    found = compare(Predictor(run.time_step), own_models.Lag(rate), run)
    assert found.one_step_rmse == pytest.approx(1e-2 * np.sqrt(2), rel=0.1)
    model, run, (stiffness, damping) = own_models.chain(2)
    true = replace(model, stiffness=stiffness, damping=damping)
    found = compare(Predictor(run.time_step), true, run)
    assert found.free_run_rmse == pytest.approx(1e-4, rel=0.1)


def test_make_bench_runs_all_that_need_nothing_else():
    here = {one.__name__.removeprefix("benchmarks.") for one in all_benchmarks.HERE}
    own_command = {"fit_machines", "long_recording", "own_models", "peers", "scale", "sweep"}
    assert "benchmarks.peers" in all_benchmarks.ELSEWHERE
    assert here == HERE - own_command - {"operations", "peer_models", "problem", "run"}
    assert all(callable(one.main) for one in all_benchmarks.HERE)
    named = {name for name in ELSEWHERE if f"benchmarks.{name}" in all_benchmarks.ELSEWHERE}
    assert named == set(ELSEWHERE) - {"torch_problem", "peer_casadi", "peer_jax"}


@pytest.fixture(scope="module")
def small():
    """The paper's problem on 120 samples."""
    run = problem.paper_recording(0.012)
    start = nominal_start([run], 0)
    return problem.problem_of(run, start)


@pytest.mark.parametrize("name", ELSEWHERE)
def test_names_that_are_imported_from_here_exist(name):
    """Of modules that need packages which are not installed, too."""
    for node in ast.walk(ast.parse((FOLDER / f"{name}.py").read_text())):
        own = isinstance(node, ast.ImportFrom) and (node.module or "").startswith("penode")
        for one in node.names if own else ():
            assert hasattr(importlib.import_module(node.module), one.name), one.name


@pytest.mark.parametrize("name", ELSEWHERE)
def test_what_needs_other_packages_is_imported_where_they_are(name):
    if importlib.util.find_spec(ELSEWHERE[name]) is None:
        pytest.skip(f"{ELSEWHERE[name]} is not installed; see docs/benchmarks.md.")
    assert importlib.import_module(f"benchmarks.{name}")


def test_the_gradient_by_torchdiffeq_is_the_objectives(small):
    pytest.importorskip("torchdiffeq", reason="torchdiffeq is not installed.")
    there = importlib.import_module("benchmarks.torch_problem")
    ours = problem.problem_of(small.run, small.machine, RungeKutta(RK4_38))
    windows = ours.windows(5)
    derivative = there.derivative_of(ours, there.closed_form, there.cramer)
    theirs = there.loss_and_gradient(ours, windows, derivative)()
    wanted = ours.objective.loss_and_gradient(ours.raw, windows)
    assert problem.check("H = 5", theirs, wanted) < 1e-12


# --- loss, gradient and terms ------------------------------------------------------------------


@pytest.mark.slow
def test_the_gradient_by_diffrax_is_the_objectives(small):
    windows = small.windows(2)
    wanted = small.objective.loss_and_gradient(small.raw, windows)
    theirs = diffrax_gradient.by_diffrax(small, windows)()
    assert problem.check("H = 2", theirs, wanted) < 1e-12
    wrong = (theirs[0], -theirs[1])
    with pytest.raises(SystemExit, match="nothing is timed"):
        problem.check("H = 2", wrong, wanted)


@pytest.mark.slow
def test_gauss_newton_terms_are_those_of_a_stored_jacobian(small):
    windows = small.windows(4)
    with float64():
        stored = gauss_newton.stored_jacobian(small.objective, windows)
        wanted = np.asarray(stored(np.asarray(small.raw)))
    normal = small.objective.gauss_newton(small.raw, windows).normal
    assert np.abs(normal - wanted).max() < 1e-10 * np.abs(wanted).max()


@pytest.mark.slow
def test_terms_of_pieces_sum_to_those_of_the_whole(small):
    whole = small.objective.gauss_newton(small.raw, small.windows(4)).normal
    pieces = memory.in_pieces(small, 4, 40)
    assert np.abs(pieces - whole).max() < 1e-10 * np.abs(whole).max()
    assert 10 < memory.own_peak() < 1e5
    memory.gradient(small, 4)
    memory.terms(small, 4)
    assert set(memory.names(small)) <= set(small.run.channels)


@pytest.mark.slow
def test_distances_from_the_roofline_are_printed(small, capsys):
    core = roofline.Core(operations=1e10, tanh=1e9, bytes=1e10)
    roofline.print_row(small, core, 4)
    printed = capsys.readouterr().out
    assert "agree to" in printed
    assert "gradient within 5 forward passes" in printed
    assert core.least(operations.Work(1e10, 1e9, 1e10)) == pytest.approx(2.0)


def test_operations_are_those_of_the_sizes():
    """Of layers 1-1-1 by hand: the output has one tanh, two products and two biases."""
    forward, back = operations.network((1, 1, 1)), operations.gradient((2, 6, 4, 2))
    assert forward.tanh == 1
    assert forward.operations == 2 + (2 + 1) + 2 + 1
    assert back.operations == 3 * operations.transition((2, 6, 4, 2)).operations
    assert operations.gauss_newton((2, 6, 4, 2), 57).operations > back.operations


@pytest.mark.slow
def test_seeds_train_together_as_alone(capsys):
    parallel_starts.main(0.02, horizons=(2,), seeds=2)
    assert "1 horizons x 2 seeds" in capsys.readouterr().out


# --- the bench, exports and long recordings ------------------------------------------------------


def test_the_bench_is_accurate_before_it_is_timed():
    drive = bench_speed.DRIVES["ideal"]
    assert bench_speed.check_accuracy("ideal", drive, 0.01) < 0.03
    assert len(bench_speed.recorded(drive, 0.01)) == 100
    assert bench_speed.peak_mebibytes() > 10


def test_a_look_up_in_c_takes_nanoseconds():
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    assert all(0.1 < time < 1e5 for time in c_lookup.nanoseconds())


def test_a_long_recording_obeys_the_voltage_equation(tmp_path):
    columns = long_recording.channels(1000, 200)
    step, resistance = long_recording.TIME_STEP, long_recording.TRACTION_300A.resistance
    assert columns["t"][0] == pytest.approx(1000 * step)
    current = np.hypot(columns["i_d"], columns["i_q"])
    voltage = np.hypot(columns["u_d"], columns["u_q"])
    assert current.max() < 300
    assert voltage.max() > resistance * current.max()
    long_recording.write(tmp_path / "long.parquet", 500, piece=200)
    assert len(pl.read_parquet(tmp_path / "long.parquet")) == 500


def test_scale_reads_in_pieces_what_was_written(tmp_path, monkeypatch):
    monkeypatch.setattr(gathered, "MANY", gathered.MANY)
    monkeypatch.setattr(gathered, "PIECE", gathered.PIECE)
    scale.check(tmp_path)
    taken = scale.Cost(memory=900.0, processor=20.0, clock=20.0)
    assert scale._against_budget("check", 10_000_000, taken).endswith("reached")
    assert scale._against_budget("check", 10_000_000, replace(taken, clock=40.0)).endswith("MISSED")
    assert scale._against_budget("check", 100, taken) == ""


def test_a_start_is_held_against_its_goal(monkeypatch, capsys):
    assert set(start.ASKED) >= {"penode --help", "penode TAB", "import penode"}
    monkeypatch.setattr(start, "_RUNS", 1)
    words = (sys.executable, "-c", "import os; assert os.environ['COMP_CWORD'] == '1'")
    monkeypatch.setattr(start, "ASKED", {"quick": (words, "penode ", 60.0)})
    assert start.main() == 0
    monkeypatch.setattr(start, "ASKED", {"never": (words, "penode ", 0.0)})
    assert start.main() == 1
    assert capsys.readouterr().out.split()[-1] == "MISSED"


def test_a_sweep_has_its_recordings_and_sizes(tmp_path):
    sweep.record(tmp_path, 2)
    assert sorted(one.name for one in tmp_path.iterdir()) == [
        "000000.csv",
        "000001.csv",
        "study.toml",
    ]
    assert sweep.size(tmp_path) == pytest.approx(
        sum(one.stat().st_size for one in tmp_path.iterdir()) / 1e3
    )


def test_machines_are_fitted_to_a_map(capsys):
    """A linear map of currents has two inductances and a magnet: the fit follows it."""
    i_d, i_q = (
        one.ravel() for one in np.meshgrid(np.linspace(-100, 50, 9), np.linspace(-90, 90, 9))
    )
    psi = np.stack([0.05 + 2e-4 * i_d, 3e-4 * i_q]).astype(complex)
    source = fit_machines.Source("linear", i_d, i_q, {0: psi, 6: 0.01 * psi}, 0.05, 100.0)
    shape = fit_machines.Shape(100.0, 50.0, {0: 6, 6: 6})
    assert fit_machines.show(source, shape) < 0.02 * 0.05
    assert "psi_PM a component" in capsys.readouterr().out


@pytest.mark.slow
def test_an_identification_is_timed():
    """The command's own defaults take longer; these are the fewest unknowns."""
    study = Study(horizon=1, candidates=(), angle_orders=(), hold="dq")
    seconds, fit = identification.timed(problem.paper_recording(0.1), study)
    assert seconds > 0
    assert fit.horizon.selected == 1
    assert all(isinstance(one, Study) for one in identification.STUDIES.values())


# --- whole, in make validate ---------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gauss_newton", "roofline", "bench_speed", "parallel_starts"])
def test_a_benchmark_runs_to_its_end(name, capsys):
    importlib.import_module(f"benchmarks.{name}").main()
    assert capsys.readouterr().out


@pytest.mark.slow
def test_a_short_sweep_is_the_same_by_one_process_and_two(capsys):
    sweep.main(2)
    assert "tables the same to the last bit: yes" in capsys.readouterr().out


@pytest.mark.slow
def test_memory_is_measured_in_processes(small, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "HORIZONS", (1, 10))
    monkeypatch.setattr(memory, "SAMPLES", (5_000, 10_000))
    monkeypatch.setattr(memory, "MANY", 20_001)
    memory.main()
    assert "20001 samples in pieces" in capsys.readouterr().out


@pytest.mark.slow
def test_commands_on_a_long_recording_are_measured(monkeypatch, capsys):
    monkeypatch.setattr(gathered, "MANY", gathered.MANY)
    monkeypatch.setattr(gathered, "PIECE", gathered.PIECE)
    monkeypatch.setattr(scale, "SAMPLES", (20_000,))
    scale.main()
    assert capsys.readouterr().out.count("| 20000 |") == 2


@pytest.mark.parametrize("name", peer_models.MODELS)
def test_peers_are_given_the_model_of_the_set(name):
    """The derivative of plain arithmetic is that of penode's model, at random states."""
    model, random = PEER_STARTS[name], np.random.default_rng(1)
    names = [part.name for part in fields(model) if getattr(model, part.name) is not None]
    values = random.uniform(0.5, 1.5, len(names)) * [float(getattr(model, key)) for key in names]
    level = 300.0 if name == "tclab" else 0.1 if name == "emps" else 12.0 if name == "tanks" else 1
    x = level * random.uniform(0.9, 1.1, len(model.states))
    u = random.normal(size=max(len(model.inputs), 1))
    with float64():
        drive = Inputs(u[: len(model.inputs), None], model.inputs)
        moved = replace(model, **dict(zip(names, values, strict=True)))
        wanted = with_batch_axis(moved).derivative(x[:, None], drive)
    found = peer_models.MODELS[name].derivative(np, x, u, values)
    np.testing.assert_allclose(found, np.asarray(wanted)[:, 0], rtol=1e-12)


def test_a_peer_is_given_the_recording_and_where_to_begin():
    start, (run, _), truth = simulated_sets.van_de_vusse(20)
    one = public_sets.PublicSet(start, run, run, known=truth)
    given = peer_models.problem_of("van_de_vusse", one, run)
    assert given.sizes == (2, 1, 3)
    np.testing.assert_array_equal(given.outputs[:, 0], run.channels["b"])
    assert given.rows == (1,)
    theta = np.log(np.array(list(truth.values())) / given.start)
    np.testing.assert_allclose(given.fixed(theta).start, list(truth.values()))


@pytest.mark.parametrize(
    ("name", "rows", "rates"),
    [
        ("wiener_hammerstein", (2,), {3: 0}),
        ("ship", (0, 2, 3, 5), {4: 3}),
        ("two_rates", (0, 2), {1: 0}),
    ],
)
def test_a_peer_reads_outputs_by_the_names_of_their_channels(name, rows, rates):
    start, (run, *_), _ = output_sets.SETS[name](20)
    given = peer_models.problem_of(name, public_sets.PublicSet(start, run, run), run)
    assert (given.rows, given.rates) == (rows, rates)
    np.testing.assert_array_equal(given.outputs, run.stack(tuple(start.outputs)))


def test_lines_of_code_are_neither_blank_nor_comments_nor_docstrings():
    def three(a):
        """Return a sum.

        It has two lines.
        """
        # the first
        b = a + len("text")

        return b

    assert peers.lines_of(three) == 3
    assert 10 < peers.lines_of(learned_sets.Tanks) < 25  # a class of a script


def test_a_peer_that_fails_or_takes_too_long_is_named(monkeypatch, tmp_path):
    def fails(command, **_):
        return subprocess.CompletedProcess(command, 1, "", "Traceback\nno such file\n")

    def lasts(command, timeout, **_):
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(subprocess, "run", fails)
    assert peers.text_of("tanks", "scipy", tmp_path).endswith("failed: no such file")
    monkeypatch.setattr(subprocess, "run", lasts)
    assert peers.text_of("tanks", "scipy", tmp_path).endswith("no answer in 600 s")
