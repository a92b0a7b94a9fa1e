"""Every Python block and every command of README and docs runs as printed."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from penode.data.save import save
from penode.pmsm.bench.config import load_config
from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import simulate
from penode.pmsm.study import flux_map_csv

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), flags=re.DOTALL)


def commands() -> list[str]:
    lines = [
        line for page in PAGES for block in blocks(page, "console") for line in block.split("\n")
    ]
    return sorted({line.removeprefix("$ ") for line in lines if line.startswith("$ ")})


@pytest.fixture
def recordings(tmp_path, monkeypatch, machine_fit):
    """run.csv, other.csv and a saved result in the working folder, as the pages have them."""
    monkeypatch.chdir(tmp_path)
    machine_fit.save("result")
    Path("result/flux_map.csv").write_text(flux_map_csv(machine_fit))
    slow, other = Lissajous(240.0, 14.0, 15.0), Lissajous(200.0, 40.0, 33.0)
    save(simulate(TRACTION_300A, slow, speed_rpm=1500.0, duration=1.0), "run.csv")
    save(simulate(TRACTION_300A, other, speed_rpm=900.0, duration=0.3), "other.csv")


@pytest.mark.parametrize(
    "page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: str(p.relative_to(ROOT))
)
def test_python_blocks_run(page, recordings):
    namespace = {"__name__": "__main__"}
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), namespace)


# What a configuration needs at least, for blocks that show a part of one.
REST = """
speed_rpm = 900.0
duration = 0.02
reference = { kind = "lissajous", amplitude = 50.0, rate_d = 140.0, rate_q = 150.0 }
"""


def test_toml_blocks_are_configurations(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = ROOT / "docs" / "how-to" / "simulate.md"
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), {"__name__": "__main__"})
    whole, part = blocks(page, "toml")
    for text in (whole, REST + part):
        Path("run.toml").write_text(text)
        assert load_config("run.toml").duration > 0


@pytest.mark.parametrize("command", [c for c in commands() if not c.startswith("make ")])
def test_commands_run(command, recordings):
    program, *arguments = command.split()
    done = subprocess.run(
        [Path(sys.executable).with_name(program), *arguments],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr


# What a make target must call; the calls themselves are run by other tests, or are this very run.
TARGETS = {
    "make demo": ["penode demo --out out/demo"],
    "make test": ["pytest"],
    "make check": ["ruff format --check", "ruff check", "mypy", "lint-imports"],
    "make bench": ["benchmarks.run"],
    "make validate": ["-m slow"],
}


@pytest.mark.parametrize("command", [c for c in commands() if c.startswith("make ")])
def test_make_targets_call_what_they_promise(command):
    done = subprocess.run([*command.split(), "-n"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for call in TARGETS[command]:
        assert call in done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_and_pictures_exist(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        assert (page.parent / target).exists(), target
