"""Run the command line as a person does, and the demo once."""

import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from validate.command import run

from penode.cli.main import main
from penode.pmsm import demo as story


def run_penode(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run ``penode`` with arguments in a process of its own."""
    command = [str(Path(sys.executable).with_name("penode")), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def without_progress(stderr: str) -> str:
    """Return what was said on standard error beside the lines of finished horizons."""
    return "".join(line for line in stderr.splitlines(True) if not line.startswith("rung "))


@pytest.fixture(scope="session")
def penode_process():
    return run_penode


@pytest.fixture
def penode(monkeypatch, capsys):
    """Run ``penode`` with arguments in this process, which spares the imports."""

    def run(*arguments: object) -> SimpleNamespace:
        monkeypatch.setattr(sys, "argv", ["penode", *map(str, arguments)])
        capsys.readouterr()
        status = 0
        try:
            main()
        except SystemExit as end:
            status = end.code or 0
        printed = capsys.readouterr()
        return SimpleNamespace(returncode=status, stdout=printed.out, stderr=printed.err)

    return run


@pytest.fixture(scope="session", params=["short", pytest.param("whole", marks=pytest.mark.slow)])
def demo(request, tmp_path_factory):
    """Return the folder ``penode demo`` wrote, and what it printed.

    The short one has a quarter of the recordings and two horizons.
    """
    folder = tmp_path_factory.mktemp("demo")
    if request.param == "whole":
        done = run_penode("demo", "--out", folder)
        assert done.returncode == 0, done.stderr
        return folder, done.stdout
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(story, "simulate", partial(quarter, story.simulate))
        patch.setattr("penode.pmsm.study_settings.HORIZONS", (1, 2, 4))
        ended = run("demo", "--out", folder)
    assert ended.status == 0, ended.printed
    return folder, ended.printed


def quarter(simulate, *arguments, duration, **options):
    """Simulate a quarter of the time."""
    return simulate(*arguments, duration=duration / 4, **options)
