"""Run the command line as a person does, and once the whole demo."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from penode.cli.main import main


def run_penode(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run ``penode`` with arguments in a process of its own."""
    command = [str(Path(sys.executable).with_name("penode")), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


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


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """Return the folder ``penode demo`` wrote, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    done = run_penode("demo", "--out", folder)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout
