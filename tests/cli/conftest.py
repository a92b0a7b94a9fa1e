"""Run the command line as a person does, and once the whole demo."""

import subprocess
import sys
from pathlib import Path

import pytest


def run_penode(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run ``penode`` with arguments in a process of its own."""
    command = [str(Path(sys.executable).with_name("penode")), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="session")
def penode():
    return run_penode


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """The folder ``penode demo`` wrote, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    done = run_penode("demo", "--out", folder)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout
