"""Files are written whole or not at all, and damaged ones are refused in a sentence."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from penode.errors import InputError
from penode.fit.archive import (
    describe_module,
    read_archive,
    restore_module,
    to_json,
    write_archive,
    write_atomically,
)

# --- one file ---------------------------------------------------------------------------------


@pytest.mark.parametrize("content", ["Ω 1\n", b"\x00\xff"])
def test_write_replaces_the_file_whole(tmp_path, content):
    path = tmp_path / "new" / "folder" / "file"
    write_atomically(path, "an older and longer content")
    write_atomically(path, content)
    assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert path.stat().st_mode & 0o777 == 0o644
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def failing(*_args, **_kwargs):
    raise OSError("No space left on device")


def break_the_disk(monkeypatch, step):
    if step == "write":
        monkeypatch.setattr("penode.fit.archive.os.fdopen", failing)
    else:
        monkeypatch.setattr(Path, step, failing)


@pytest.mark.parametrize("step", ["write", "chmod", "replace"])
def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch, step):
    path = tmp_path / "result.json"
    write_atomically(path, "old")
    with monkeypatch.context() as broken:
        break_the_disk(broken, step)
        with pytest.raises(OSError, match="No space left"):
            write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


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


# --- models -----------------------------------------------------------------------------------


def test_models_round_trip(system):
    arrays = {}
    document = json.loads(to_json(describe_module(system.model, "model", arrays)))
    back = restore_module(document, arrays)
    assert type(back) is type(system.model)
    assert jax.tree.structure(back) == jax.tree.structure(system.model)
    for found, leaf in zip(jax.tree.leaves(back), jax.tree.leaves(system.model), strict=True):
        np.testing.assert_array_equal(found, leaf)


def test_static_fields_are_kept(systems):
    arrays = {}
    document = describe_module(systems["mlp machine"].model, "model", arrays)
    back = restore_module(json.loads(to_json(document)), arrays)
    assert (back.flux.current_scale, back.flux.flux_scale) == (100.0, 0.4)


@pytest.mark.parametrize(
    ("reference", "reason"),
    [
        ("penode_no_such_module:Model", "cannot be imported"),
        ("penode.models.networks:NoSuchNetwork", "cannot be imported"),
        ("penode_no_such_module:Model", "add that folder to PYTHONPATH"),
        ("__main__:NoSuchModel", "move it into a module of its own"),
        ("builtins:dict", "is no model"),
        ("os:system", "is no model"),
    ],
)
def test_only_importable_model_parts_are_restored(reference, reason):
    with pytest.raises(InputError, match=rf"{reference}.*{reason}.*[.]$"):
        restore_module({"class": reference, "fields": {}}, {})


# --- both files -------------------------------------------------------------------------------


@pytest.fixture
def archive(tmp_path):
    write_archive(tmp_path, {"schema": "x", "n": [1, None]}, {"a.b[0]": np.arange(500.0)})
    return tmp_path


def test_archive_round_trips(archive):
    document, arrays = read_archive(archive)
    assert document == {"schema": "x", "n": [1, None]}
    assert list(arrays) == ["a.b[0]"]
    np.testing.assert_array_equal(arrays["a.b[0]"], np.arange(500.0))
    assert sorted(p.name for p in archive.iterdir()) == ["fit.json", "fit.npz"]


def test_the_json_is_written_last(tmp_path, monkeypatch):
    """A folder with a new document has the arrays it speaks of."""
    order = []
    monkeypatch.setattr(
        "penode.fit.archive.write_atomically", lambda path, _: order.append(path.name)
    )
    write_archive(tmp_path, {}, {})
    assert order == ["fit.npz", "fit.json"]


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


def put_an_object_in(path):
    """Store an array that only a pickle can hold."""
    np.savez(path, **{"a.b[0]": np.array([{}, None], dtype=object)})


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("fit.json", shorten),
        ("fit.json", empty),
        ("fit.json", overwrite),
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
    with pytest.raises(InputError, match=rf"{name}: no such file; give the folder"):
        read_archive(archive)


def test_a_write_that_fails_halfway_is_not_read_as_a_fit(archive, monkeypatch):
    """New arrays beside the old document would be a fit that nobody made."""
    before = read_archive(archive)[1]["a.b[0]"]

    def fail_at_json(path, content):
        return failing() if path.name == "fit.json" else write_atomically(path, content)

    with monkeypatch.context() as broken:
        broken.setattr("penode.fit.archive.write_atomically", fail_at_json)
        with pytest.raises(OSError, match="No space left"):
            write_archive(archive, {"schema": "y"}, {"a.b[0]": np.zeros(500)})
    try:
        document, arrays = read_archive(archive)
    except InputError:
        return
    assert document["schema"] == "x"
    np.testing.assert_array_equal(arrays["a.b[0]"], before)
