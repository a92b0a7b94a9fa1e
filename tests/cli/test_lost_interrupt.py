"""Ctrl-C inside a destructor or a callback is not lost."""

import subprocess
import sys

import pytest

CODE = """
import sys, time
from penode.cli.lost_interrupt import raise_lost_interrupts

class Gone:
    def __del__(self):
        raise {error}

raise_lost_interrupts()
try:
    Gone()
    for _ in range(300):
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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout == printed
    assert ("ValueError" in done.stderr) == (error == "ValueError")
    assert "KeyboardInterrupt" not in done.stderr
