"""Ctrl-C inside a destructor or a callback is not lost."""

import subprocess
import sys

import pytest

from penode.cli import process

CODE = """
import importlib.util, sys, time
spec = importlib.util.spec_from_file_location("process", sys.argv[1])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)

class Gone:
    def __del__(self):
        raise {error}

module.raise_lost_interrupts()
try:
    Gone()
    for _ in range(100):
        time.sleep(0.01)
    print("went on")
except KeyboardInterrupt:
    print("stopped")
"""


@pytest.mark.parametrize(
    ("error", "printed"), [("KeyboardInterrupt", "stopped\n"), ("ValueError", "went on\n")]
)
def test_an_interrupt_that_python_drops_comes_again(error, printed):
    code = CODE.format(error=error)
    command = [sys.executable, "-c", code, process.__file__]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.stdout == printed
    assert ("ValueError" in done.stderr) == (error == "ValueError")
    assert "KeyboardInterrupt" not in done.stderr
