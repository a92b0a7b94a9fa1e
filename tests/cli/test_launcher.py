"""Ctrl-C is answered from the first import of the command to its last step."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

LAUNCHER = Path(__file__).parents[2] / "src" / "penode_launcher.py"


def launched(tmp_path, command, *, imported="", ignored=False):
    """Run the launcher before a package whose command line is given, in a process of its own."""
    package = tmp_path / "penode" / "cli"
    package.mkdir(parents=True)
    (tmp_path / "penode" / "__init__.py").write_text(imported)
    (package / "__init__.py").touch()
    (package / "main.py").write_text(f"import os, signal, sys, time\ndef main():\n    {command}\n")
    (tmp_path / LAUNCHER.name).write_bytes(LAUNCHER.read_bytes())
    before = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); " if ignored else ""
    return subprocess.run(
        [sys.executable, "-c", f"{before}import penode_launcher; penode_launcher.main()"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
    )


CTRL_C = "os.kill(os.getpid(), signal.SIGINT)"
STOPPED = (130, "Stopped; nothing was written.\n")


def test_ctrl_c_during_the_imports(tmp_path):
    """Also where an import goes on without what it could not import."""
    package = f"import os, signal\ntry:\n    {CTRL_C}\nexcept BaseException:\n    pass\n"
    done = launched(tmp_path, "sys.exit(0)", imported=package)
    assert (done.returncode, done.stderr) == STOPPED


def test_ctrl_c_before_the_command_has_begun(tmp_path):
    done = launched(tmp_path, CTRL_C)
    assert (done.returncode, done.stderr) == STOPPED


def test_ctrl_c_within_the_command_is_the_commands(tmp_path):
    command = f"try: {CTRL_C}; time.sleep(9)\n    except KeyboardInterrupt: sys.exit(3)"
    done = launched(tmp_path, command)
    assert (done.returncode, done.stderr) == (3, "")


def test_ctrl_c_that_interrupts_twice(tmp_path):
    """Polars raises an interrupt of its own, and Python's comes up where that one is answered."""
    (tmp_path / "run.csv").write_text("a,b\n" + "1.0,2.0\n" * 20_000)
    command = (
        "import polars, threading; "
        f"threading.Timer(0.1, lambda: {CTRL_C}).start()\n"
        f"    while True: polars.read_csv({str(tmp_path / 'run.csv')!r})"
    )
    done = launched(tmp_path, command)
    assert (done.returncode, done.stderr) == STOPPED


def test_ctrl_c_while_closing_down_changes_nothing(tmp_path):
    command = f"import atexit; atexit.register(lambda: {CTRL_C}); sys.exit(1)"
    done = launched(tmp_path, command)
    assert (done.returncode, done.stderr) == (1, "")


def test_ctrl_c_while_a_command_imports_what_it_does(tmp_path):
    code = (
        "import os, signal, sys, penode.cli.main as cli\n"
        f"def late(name): {CTRL_C}; sys.exit(0)\n"
        "cli.import_module = late\n"
        "sys.argv = ['penode', 'identify', 'run.csv', '--out', 'result']\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "cli.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, cwd=tmp_path
    )
    assert (done.returncode, done.stderr) == STOPPED
    assert not list(tmp_path.iterdir())


def test_where_ctrl_c_is_ignored_it_stays_ignored(tmp_path):
    """As under nohup."""
    done = launched(tmp_path, f"{CTRL_C}; sys.exit(4)", imported="", ignored=True)
    assert (done.returncode, done.stderr) == (4, "")


def test_the_command_is_launched_this_way():
    text = (LAUNCHER.parents[1] / "pyproject.toml").read_text()
    assert 'penode = "penode_launcher:main"' in text


def test_a_command_without_a_sentence_of_its_own_gets_one(penode, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("penode.cli.report.Fit.load", interrupted)
    done = penode("report", "result")
    assert done.returncode == 130
    assert done.stderr == "Stopped; what was not finished is not written.\n"


@pytest.mark.skipif(sys.platform == "win32", reason="No such signal.")
def test_the_launcher_imports_nothing_of_the_package(tmp_path):
    code = "import sys, penode_launcher; sys.exit('penode' in sys.modules)"
    env = {**os.environ, "PYTHONPATH": str(LAUNCHER.parent)}
    assert subprocess.run([sys.executable, "-c", code], env=env, timeout=60).returncode == 0
