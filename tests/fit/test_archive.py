"""Files are written whole or not at all, and damaged ones are refused in a sentence."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from penode.errors import InputError
from penode.fit.archive import archive as archived
from penode.fit.archive import read_archive, sha256, to_json, write_atomically

# --- one file ---------------------------------------------------------------------------------


@pytest.mark.parametrize("content", ["Ω 1\n", b"\x00\xff"])
def test_write_replaces_the_file_whole(tmp_path, content):
    path = tmp_path / "new" / "folder" / "file"
    write_atomically(path, "an older and longer content")
    write_atomically(path, content)
    assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert [p.name for p in path.parent.iterdir()] == ["file"]


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_a_written_file_has_the_permissions_of_any_other(tmp_path, mask):
    before = os.umask(mask)
    try:
        write_atomically(tmp_path / "result.json", "new")
    finally:
        os.umask(before)
    assert (tmp_path / "result.json").stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_name_as_long_as_a_name_can_be_is_written(tmp_path):
    path = tmp_path / ("x" * 251 + ".csv")
    write_atomically(path, "new")
    assert path.read_text() == "new"


def part_of(path, monkeypatch, process):
    """Leave what a process that was killed while it wrote leaves."""
    with monkeypatch.context() as killed:
        killed.setattr("penode.fit.archive.os.getpid", lambda: process)
        killed.setattr(Path, "replace", failing)
        killed.setattr(Path, "unlink", lambda *_, **__: None)
        with pytest.raises(OSError, match="No space left"):
            write_atomically(path, "part")
    (part,) = path.parent.glob(".*.part")
    return part


def test_what_a_dead_process_left_is_removed_and_what_a_live_one_writes_is_not(
    tmp_path, monkeypatch
):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    path = tmp_path / "result.json"
    left = part_of(path, monkeypatch, dead.pid)
    write_atomically(path, "new")
    assert not left.exists()
    written = part_of(path, monkeypatch, os.getppid())
    write_atomically(path, "newer")
    assert written.exists()


def failing(*_args, **_kwargs):
    raise OSError(28, "No space left on device")


def break_the_disk(monkeypatch, step):
    if step == "write":
        monkeypatch.setattr(Path, "write_bytes", failing)
    else:
        monkeypatch.setattr(Path, step, failing)


@pytest.mark.parametrize("step", ["write", "replace"])
def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch, step):
    path = tmp_path / "result.json"
    write_atomically(path, "old")
    with monkeypatch.context() as broken:
        break_the_disk(broken, step)
        with pytest.raises(OSError, match="No space left") as said:
            write_atomically(path, "new")
    assert said.value.filename == str(path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_a_failed_write_leaves_no_folder(tmp_path, monkeypatch):
    with monkeypatch.context() as broken:
        break_the_disk(broken, "write")
        with pytest.raises(OSError, match="No space left"):
            write_atomically(tmp_path / "new" / "folder" / "result.json", "new")
    assert not (tmp_path / "new").exists()


def refuse_constant(name):
    raise AssertionError(f"{name} is not JSON")


json_values = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text()),
    lambda inner: st.one_of(st.lists(inner), st.dictionaries(st.text(), inner)),
    max_leaves=10,
)


@settings(max_examples=50)
@given(json_values)
def test_json_is_strict_and_keeps_all_but_the_infinite(document):
    def finite(value):
        if isinstance(value, dict):
            return {key: finite(item) for key, item in value.items()}
        if isinstance(value, list):
            return [finite(item) for item in value]
        return None if isinstance(value, float) and not np.isfinite(value) else value

    assert json.loads(to_json(document), parse_constant=refuse_constant) == finite(document)


def test_json_takes_numpy_scalars_and_tuples():
    document = {"a": (np.float64(1.5), np.int64(3)), 7: np.float32("nan")}
    assert json.loads(to_json(document)) == {"a": [1.5, 3], "7": None}


# --- both files -------------------------------------------------------------------------------


def write(folder, document, arrays):
    for name, content in archived(document, arrays).items():
        (folder / name).write_bytes(content)


@pytest.fixture
def archive(tmp_path):
    write(tmp_path, {"schema": "x", "n": [1, None]}, {"a.b[0]": np.arange(500.0)})
    return tmp_path


def test_archive_round_trips(archive):
    document, arrays = read_archive(archive)
    assert document == {"schema": "x", "n": [1, None]}
    assert list(arrays) == ["a.b[0]"]
    np.testing.assert_array_equal(arrays["a.b[0]"], np.arange(500.0))


def test_an_archive_of_before_the_document_had_a_digest_is_read(archive):
    document = json.loads((archive / "fit.json").read_text())
    del document["sha256"]
    (archive / "fit.json").write_text(json.dumps(document))
    assert read_archive(archive)[0] == {"schema": "x", "n": [1, None]}


def shorten(path):
    path.write_bytes(path.read_bytes()[:-20])


def empty(path):
    path.write_bytes(b"")


def overwrite(path):
    path.write_bytes(b"\x93\xff not what it was")


def flip(path):
    content = bytearray(path.read_bytes())
    for at in range(60, len(content) // 2, 3):
        content[at] ^= 0xFF
    path.write_bytes(content)


def change_a_number(path):
    text = path.read_text()
    path.write_text(text.replace("1,", "2,"))
    assert path.read_text() != text


def nest_deeply(path):
    path.write_text("[" * 100_000)


def put_an_object_in(path):
    """Store an array that only a pickle can hold."""
    np.savez(path, **{"a.b[0]": np.array([{}, None], dtype=object)})


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("fit.json", shorten),
        ("fit.json", empty),
        ("fit.json", overwrite),
        ("fit.json", change_a_number),
        ("fit.json", nest_deeply),
        ("fit.npz", shorten),
        ("fit.npz", empty),
        ("fit.npz", overwrite),
        ("fit.npz", flip),
        ("fit.npz", put_an_object_in),
    ],
)
def test_damaged_files_are_refused_in_a_sentence(archive, name, damage):
    damage(archive / name)
    with pytest.raises(InputError, match=r"damaged.*run the identification again\.$") as caught:
        read_archive(archive)
    assert str(archive) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["fit.json", "fit.npz"])
def test_a_missing_file_is_named(archive, name):
    (archive / name).unlink()
    with pytest.raises(InputError, match=rf"{name}: no such file or folder; give the folder"):
        read_archive(archive)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(InputError, match=r"resultt: no such file or folder"):
        read_archive(tmp_path / "resultt" / "fit")


def test_a_new_document_beside_old_arrays_is_refused(archive):
    new = archived({"schema": "y"}, {"a.b[0]": np.zeros(500)})
    (archive / "fit.json").write_bytes(new["fit.json"])
    with pytest.raises(InputError, match="do not belong together"):
        read_archive(archive)


def test_arrays_with_their_digest_that_are_no_archive_are_refused(archive):
    document = json.loads((archive / "fit.json").read_text())
    put_an_object_in(archive / "fit.npz")
    document["arrays_sha256"] = sha256((archive / "fit.npz").read_bytes())
    del document["sha256"]
    (archive / "fit.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"damaged.*run the identification again\.$"):
        read_archive(archive)


def test_arrays_that_unpack_to_far_more_are_refused_packed(tmp_path):
    for name, content in archived({}, {"excited": np.zeros(12_000_000)}).items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=r"bytes unpack to 960\d{5}\); run the"):
        read_archive(tmp_path)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no such device here")
@pytest.mark.parametrize("name", ["fit.json", "fit.npz"])
def test_a_device_in_place_of_a_file_is_not_read(tmp_path, name):
    for made, content in archived({}, {"excited": np.zeros(3)}).items():
        (tmp_path / made).write_bytes(content)
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(InputError, match=f"{name}: this is a pipe or a device"):
        read_archive(tmp_path)
