"""Output that cannot be shown or that nobody reads does not end a command."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from penode.cli import process


def run(code, **streams_):
    """Run code in a process of its own, with tolerant streams and without the rest of penode."""
    source = Path(process.__file__).read_text(encoding="utf-8")
    return subprocess.run(
        [sys.executable, "-c", f"{source}\nuse_tolerant_streams()\n{code}"], timeout=60, **streams_
    )


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [
        ("cp1252", "R = 9.9 mohm ± 2 %, 3 µs, a – b"),
        ("ascii", "R = 9.9 mohm +- 2 %, 3 us, a - b"),
        ("utf-8", "R = 9.9 mΩ ± 2 %, 3 µs, a – b"),
    ],
)
def test_what_an_encoding_lacks_is_spelled(encoding, shown):
    code = "print('R = 9.9 mΩ ± 2 %, 3 µs, a – b')"
    env = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    done = run(code, capture_output=True, env=env)
    assert done.returncode == 0, done.stderr
    assert done.stdout.decode(encoding).strip() == shown


def test_a_reader_that_has_gone_does_not_end_the_work():
    """As in ``penode check run.csv | head -1``: the status is that of the work."""
    reading, writing = os.pipe()
    os.close(reading)
    code = "print('x' * 100_000); sys.stdout.flush(); print('y'); flush_output(); sys.exit(1)"
    done = run(code, stdout=writing, stderr=subprocess.PIPE)
    os.close(writing)
    assert (done.returncode, done.stderr) == (1, b"")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="No full device on this system.")
def test_a_full_disk_is_an_error_once():
    code = "print('x')\ntry: flush_output()\nexcept OSError as error: sys.exit(error.errno)"
    with open("/dev/full", "w") as full:
        done = run(code, stdout=full, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (28, b"")


def test_streams_of_a_program_stay(monkeypatch):
    mine = io.StringIO()
    monkeypatch.setattr(sys, "stdout", mine)
    process.use_tolerant_streams()
    assert sys.stdout is mine


def test_no_output_is_no_error(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    process.use_tolerant_streams()
    process.flush_output()


def test_every_command_has_them(penode, monkeypatch):
    used = []
    monkeypatch.setattr("penode.cli.main.use_tolerant_streams", lambda: used.append("use"))
    monkeypatch.setattr("penode.cli.main.flush_output", lambda: used.append("flush"))
    assert penode("--help").returncode == 0
    assert used == ["use", "flush"]


def test_output_on_a_full_disk_ends_with_a_sentence(penode, monkeypatch):
    def fail():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("penode.cli.main.flush_output", fail)
    done = penode("--help")
    assert done.returncode == 2
    assert done.stderr.startswith("error: no space left on device; ")
