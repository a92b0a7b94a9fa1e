"""Every Python block and every command of README and docs runs as printed."""

import re
import shutil
import subprocess
import sys
import tomllib
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.pmsm.injection import one_axis_a_file
from validate.operating_points import drawn

from penode.bench.config import load_config
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli.main import main
from penode.data.load import read
from penode.data.save import save
from penode.pmsm.recording.guess import guess_study
from penode.pmsm.recording.study_text import study_text
from penode.pmsm.result_files import flux_map_csv
from penode.pmsm.study_file import load_study
from penode.pmsm.sweep.task import run as do

ROOT = Path(__file__).parents[1]
HOW_TO = ROOT / "docs" / "how-to"
DRIVE_PAGE = HOW_TO / "drive-the-identified-machine.md"
FLEET_PAGE = HOW_TO / "sweep-a-fleet.md"
OWN_MODEL_PAGE = HOW_TO / "report-your-own-model.md"
TOP = [ROOT / f"{name}.md" for name in ("README", "ARCHITECTURE", "CONTRIBUTING", "CHANGELOG")]
PAGES = [*TOP, *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), flags=re.DOTALL)


def commands() -> list[str]:
    lines = [
        line for page in PAGES for block in blocks(page, "console") for line in block.split("\n")
    ]
    return sorted({line.removeprefix("$ ") for line in lines if line.startswith("$ ")})


# The code as printed, on a short ladder: the whole one is climbed by other tests. The tutorial's
# recordings are as long as those of `page_files`, so that the same programs serve all pages.
SHORT_LADDER = (1, 2, 4)
SHORTER = {
    "duration=2.0": "duration=0.5",
    "identify([run], ": "identify([run], study=penode.pmsm.Study(horizon=1, candidates=()), ",
    "duration=0.6": "duration=0.3",
    "ladder_plan((1, 3, 9, 27))": "ladder_plan((1, 3))",
    "ladder_plan((1, 5, 20))": "ladder_plan((1, 5))",
    "step, samples = 0.01, 3000": "step, samples = 0.01, 1500",
    "for h in (10, 30)": "for h in (10,)",
    "ladder_plan((10, 30))": "ladder_plan((10,))",
    "ratio=1.0), [run])": "ratio=1.0), [run], plan=penode.ladder_plan((8, 16)))",
    "[run], validation=[unseen])": "[run], validation=[unseen], plan=penode.ladder_plan((4, 8)))",
}


@pytest.fixture(scope="session")
def page_files(tmp_path_factory, machine_fit):
    """Return a folder with what the pages take for granted: recordings, a result, studies."""
    folder = tmp_path_factory.mktemp("pages")
    machine_fit.save(folder / "result")
    (folder / "result" / "flux_map.csv").write_text(flux_map_csv(machine_fit))
    for name in ("cold", "warm"):
        machine_fit.save(folder / name)
    slow, other = Lissajous(240.0, 14.0, 15.0), Lissajous(200.0, 40.0, 33.0)
    save(simulate(TRACTION_300A, slow, speed_rpm=1500.0, duration=0.5), folder / "run.csv")
    save(simulate(TRACTION_300A, other, speed_rpm=900.0, duration=0.3), folder / "other.csv")
    bench = drawn(3).columns
    rows = np.column_stack(list(bench.values()))
    np.savetxt(folder / "bench.csv", rows, "%.9g", ",", header=",".join(bench), comments="")
    for run in one_axis_a_file(delay=2):  # their rotor stands still, as the log says
        still = {**run.channels, "theta_el": np.zeros(len(run))}
        save(replace(run, channels=still), folder / run.name)
    guess = guess_study(read(folder / "run.csv")[0])
    (folder / "study.toml").write_text(study_text(guess, "run.csv", "study.toml"))
    (folder / "drive.toml").write_text(blocks(DRIVE_PAGE, "toml")[0])
    (folder / "fleet.toml").write_text(blocks(FLEET_PAGE, "toml")[0])
    return folder


@pytest.fixture
def recordings(page_files, tmp_path, monkeypatch):
    """Make a copy of them the working folder."""
    shutil.copytree(page_files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if blocks(p, "python") and p != OWN_MODEL_PAGE],
    ids=lambda p: str(p.relative_to(ROOT)),
)
def test_python_blocks_run(page, recordings, monkeypatch):
    monkeypatch.setattr("penode.pmsm.study_settings.HORIZONS", SHORT_LADDER)
    namespace = {"__name__": "__main__"}
    for block in blocks(page, "python"):
        for printed, shorter in SHORTER.items():
            block = block.replace(printed, shorter)
        exec(compile(block, str(page), "exec"), namespace)


# What a configuration needs at least, for blocks that show a part of one.
REST = """
speed_rpm = 900.0
duration = 0.02
reference = { kind = "lissajous", amplitude = 50.0, rate_d = 140.0, rate_q = 150.0 }
"""


def test_toml_blocks_are_configurations(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = HOW_TO / "simulate.md"
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), {"__name__": "__main__"})
    whole, part = blocks(page, "toml")
    for text in (whole, REST + part):
        Path("run.toml").write_text(text)
        assert load_config("run.toml").duration > 0


def test_the_identified_machine_and_its_dead_time_are_a_configuration(recordings):
    whole, part = blocks(DRIVE_PAGE, "toml")
    Path("drive.toml").write_text(whole + part)
    simulation = load_config("drive.toml")
    assert simulation.machine.name == "result"
    assert simulation.drive.inverter.dead_time.duration > 0


@pytest.mark.parametrize(
    "name",
    [
        "long-recordings",
        "map-your-channels",
        "record-a-good-experiment",
        "standstill",
        "sweep-a-fleet",
        "terms-and-temperature",
        "uncertainty-budget",
    ],
)
def test_toml_blocks_are_study_files(name, tmp_path):
    texts = blocks(HOW_TO / f"{name}.md", "toml")
    assert texts
    for text in texts:
        (tmp_path / "study.toml").write_text(text)
        load_study(tmp_path / "study.toml")


def own_commands():
    """Return the commands of pages but that of one's own model, which its own test runs."""
    every = [c for c in commands() if c.startswith("penode ")]
    return [c for c in every if f"$ {c}" not in OWN_MODEL_PAGE.read_text()]


def test_ones_own_model_ends_in_its_report(tmp_path, monkeypatch):
    """The page saves a fit of a class in a module, which its command then reads."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    module, *rest = blocks(OWN_MODEL_PAGE, "python")
    Path("dc_motor.py").write_text(module)
    namespace = {"__name__": "__main__"}
    try:
        for block in (module, *rest):
            exec(compile(block, str(OWN_MODEL_PAGE), "exec"), namespace)
    finally:
        sys.modules.pop("dc_motor", None)
    (command,) = blocks(OWN_MODEL_PAGE, "console")
    program, *arguments = command.removeprefix("$ ").split()
    done = subprocess.run(
        [Path(sys.executable).with_name(program), *arguments],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    page = Path("motor/report.html").read_text()
    assert "friction over speed: " in page
    assert "free-run rmse of speed in" in page


#: The shipped configurations are simulated and identified by a test of their own.
LONG_AND_SHORT = ("simulate paper_simulation", "simulate well_designed")


@contextmanager
def in_this_process(count):
    """Give a sweep's tasks to this process."""
    assert count >= 1
    yield lambda tasks: ((task, do(task)) for task in tasks)


@pytest.mark.parametrize("command", own_commands())
def test_commands_run(command, recordings, monkeypatch, capsys):
    """In this process, which spares the imports; tests/cli runs commands in one of their own."""
    monkeypatch.setattr("penode.pmsm.study_settings.HORIZONS", SHORT_LADDER)
    monkeypatch.setattr(sys, "argv", command.replace(*LONG_AND_SHORT).split())
    if command.startswith("penode init"):
        Path("study.toml").unlink()  # it never overwrites
    if command.startswith("penode identify"):
        shutil.rmtree("result")  # it never replaces one unasked
    if command.startswith("penode sweep"):
        for path in set(Path().glob("*.csv")) - {Path("run.csv")}:
            path.unlink()  # a fleet of one will do
        monkeypatch.setattr("penode.cli.sweep.processes", in_this_process)
    status = 0
    try:
        main()
    except SystemExit as end:
        status = end.code or 0
    # Horizons this few need not have a plateau, which status 1 says; everything is written.
    assert status <= command.startswith("penode identify"), capsys.readouterr().err


def test_pip_installs_extras_that_there_are():
    (command,) = [c for c in commands() if not c.startswith(("penode ", "make "))]
    found = re.fullmatch(r"pip install '\.\[(.+)\]'", command)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(found[1].split(",")) <= set(project["optional-dependencies"])


# What a make target must call; the calls themselves are run by other tests, or are this very run.
TARGETS = {
    "make demo": ["penode demo --out out/demo"],
    "make test": ["pytest"],
    "make check": [
        "ruff format --check",
        "ruff check",
        "mypy",
        "lint-imports",
        "mkdocs build --strict",
    ],
    "make bench": ["benchmarks.run"],
    "make validate": ["-m slow"],
}


@pytest.mark.parametrize("command", [c for c in commands() if c.startswith("make ")])
def test_make_targets_call_what_they_promise(command):
    done = subprocess.run([*command.split(), "-n", "-B"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for call in TARGETS[command]:
        assert call in done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_and_pictures_exist(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        assert "://" in target or (page.parent / target).exists(), target
