"""Binary files are decoded apart, under limits; a child that dies is a refusal."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from penode.data import isolated_decoder, isolation
from penode.data.load import read
from penode.errors import InputError

X = np.random.default_rng(0).normal(size=12)


def refusal(path):
    with pytest.raises(InputError) as caught:
        read(path)
    sentence = str(caught.value)
    assert sentence.startswith(f"{path}: ")
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


def mat_file(folder, **variables):
    savemat(folder / "run.mat", variables or {"t": np.arange(12) * 1e-3, "x": X})
    return folder / "run.mat"


@pytest.fixture
def child_does(tmp_path, monkeypatch):
    """Return a function that puts a script in place of the child."""

    def replace(script):
        path = tmp_path / "child.py"
        path.write_text(script)
        monkeypatch.setattr(isolation, "_CHILD", path)

    return replace


def crashing(folder):
    """Return a MAT file whose numbers are of type 0, which ends the process that scipy is in."""
    path = mat_file(folder)
    content = bytearray(path.read_bytes())
    assert content[176] == 9
    content[176] = 0
    path.write_bytes(content)
    return path


def test_a_damaged_file_that_crashes_the_library_is_refused(tmp_path):
    refusal(crashing(tmp_path))


@pytest.mark.skipif(sys.platform == "win32", reason="no signals there")
def test_a_crash_is_refused_with_its_status(tmp_path, child_does):
    child_does("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    assert "crashed (status -11)" in refusal(mat_file(tmp_path))


def test_neither_jax_nor_another_library_is_imported():
    script = f"""
import runpy, sys
child = runpy.run_path({isolated_decoder.__file__!r})
child["_reader"]({{"reader": "mat", "libraries": [], "path": sys.path}})
print([name for name in ("jax", "penode.engine", "polars", "h5py", "scipy") if name in sys.modules])
"""
    run = subprocess.run(
        [sys.executable, "-P", "-c", script], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"


def test_little_that_unpacks_to_much_is_refused(tmp_path, monkeypatch):
    savemat(tmp_path / "run.mat", {"x": np.zeros(6_000_000)}, do_compression=True)
    assert len(read(tmp_path / "run.mat")[0].columns["x"]) == 6_000_000
    monkeypatch.setattr(isolation, "_MEMORY", 60 << 20)
    assert "memory" in refusal(tmp_path / "run.mat")


def test_a_struct_that_declares_more_than_there_is_takes_no_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(isolation, "_MEMORY", 300 << 20)
    path = mat_file(tmp_path, s=np.zeros((1, 3), dtype=[("a", object)]))
    content = path.read_bytes().replace(
        b"\1\0\0\0\3\0\0\0", (1).to_bytes(4, "little") + (200_000).to_bytes(4, "little"), 1
    )
    path.write_bytes(content)
    assert len(content) < 600
    sentence = refusal(path)
    assert "declares 200000 values" in sentence or "damaged" in sentence


def test_a_file_that_takes_too_long_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(isolation, "_SECONDS", 0)
    table = pl.DataFrame({"t": np.arange(2_000_000) * 1e-4})
    table.write_parquet(tmp_path / "run.parquet")
    monkeypatch.setattr(isolation, "_SECONDS_PER_BYTE", 0.0)
    assert "longer than" in refusal(tmp_path / "run.parquet")


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit there")
def test_memory_is_watched_where_the_system_has_no_limit():
    script = (
        f"import runpy, threading, time; child = runpy.run_path('{isolated_decoder.__file__}')\n"
        "threading.Thread(target=child['watch_memory'], args=(50 << 20,), daemon=True).start()\n"
        "time.sleep(0.2); held = b'1' * (100 << 20); time.sleep(20)"
    )
    # A shell between, as Linux counts the memory of the process that starts another in it.
    command = [*("sh", "-c", '"$0" -c "$1"; exit $?'), sys.executable, script]
    assert subprocess.run(command, check=False, timeout=15).returncode == 3


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"[]\n",
        b"not json\n",
        b'{"column": "x", "length": 1000000000000}\n',
        b'{"column": "x", "length": -1}\n',
        b'{"column": "x", "length": 4}\n12345678',
        b'{"column": "x"}\n',
        b'{"column": "x", "length": 0}\n{"units": 3, "clocks": {}, "text": {}}\n',
        b'{"column": "x", "length": 1}\n12345678{"units": {}, "clocks": {}}\n',
    ],
)
def test_an_answer_that_is_none_is_a_crash(tmp_path, child_does, answer):
    child_does(f"import sys; sys.stdin.buffer.read(100); sys.stdout.buffer.write({answer!r})")
    assert "crashed" in refusal(mat_file(tmp_path))


def test_a_child_that_waits_for_ever_is_ended(tmp_path, child_does, monkeypatch):
    child_does("import time; time.sleep(60)")
    monkeypatch.setattr(isolation, "_WAIT", 0.1)
    begin = time.monotonic()
    assert "longer than" in refusal(mat_file(tmp_path))
    assert time.monotonic() - begin < 10


def test_what_a_library_prints_is_no_answer(tmp_path, monkeypatch):
    (tmp_path / "nptdms.py").write_text(
        "print('{}', flush=True); raise ValueError('of the library')"
    )
    (tmp_path / "run.tdms").write_bytes(b"TDSm")
    monkeypatch.syspath_prepend(tmp_path)
    assert "(ValueError)" in refusal(tmp_path / "run.tdms")


def test_what_a_library_prints_is_not_seen(tmp_path, capfd):
    refusal(crashing(tmp_path))
    read(mat_file(tmp_path))
    assert capfd.readouterr() == ("", "")


def test_no_child_and_no_folder_stay_behind(tmp_path, monkeypatch):
    started, begin = [], subprocess.Popen

    def kept(*arguments, **options):
        started.append(begin(*arguments, **options))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", kept)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    refusal(crashing(tmp_path))
    read(mat_file(tmp_path))
    assert not list((tmp_path / "temporary").iterdir())
    assert [child.returncode is None for child in started] == [False, False]


PARENT = """
import sys, time
from penode.data.isolation import Decoder
decoder = Decoder("mat")
print(decoder._folder.name, flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="an open file stays there")
def test_the_folder_of_a_parent_that_was_killed_goes(tmp_path):
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    folder = Path(parent.stdout.readline().strip())
    (folder / "content").write_bytes(b"MATLAB")
    parent.kill()
    parent.communicate()
    limit = time.monotonic() + 60
    while folder.exists() and time.monotonic() < limit:
        time.sleep(0.02)
    assert not list(tmp_path.iterdir())
