"""Compiled programs are shared by a user's checkouts, and do not fill the disk."""

import os

import jax
import pytest

from penode.cli import compilation_cache
from penode.cli.compilation_cache import remove_oldest, use_compilation_cache


@pytest.fixture
def folder_kept():
    before = jax.config.values["jax_compilation_cache_dir"]
    yield
    jax.config.update("jax_compilation_cache_dir", before)


def test_programs_lie_in_the_users_folder_unless_another_is_named(
    tmp_path, monkeypatch, folder_kept
):
    named = os.environ["JAX_COMPILATION_CACHE_DIR"]
    assert str(use_compilation_cache()) == named
    assert jax.config.values["jax_compilation_cache_dir"] == named
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = use_compilation_cache()
    assert folder.parent == tmp_path / ".cache" / "penode" / "compiled"
    assert jax.config.values["jax_compilation_cache_dir"] == str(folder)
    monkeypatch.setattr(compilation_cache, "processor_flags", lambda: "flags : another processor")
    assert use_compilation_cache() != folder


@pytest.mark.parametrize("said", [None, "2"])
def test_small_programs_are_kept_too_unless_the_environment_says_from_when(monkeypatch, said):
    name, seconds = "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", {}
    monkeypatch.delenv(name)
    if said:
        monkeypatch.setenv(name, said)
    monkeypatch.setattr(compilation_cache.jax.config, "update", seconds.__setitem__)
    use_compilation_cache()
    assert seconds == ({} if said else {name.lower(): 0.0})


def test_the_least_recently_used_programs_are_removed_once_a_day(tmp_path):
    programs = [tmp_path / version / name for version in ("old", "new") for name in ("a", "b")]
    for age, program in enumerate(programs):
        program.parent.mkdir(exist_ok=True)
        program.write_bytes(bytes(100))
        os.utime(program, (1e9 + age, 0.0))
    os.utime(programs[0], (2e9, 0.0))  # written first and read last
    remove_oldest(tmp_path, most=250)
    assert [program.exists() for program in programs] == [True, False, False, True]
    remove_oldest(tmp_path, most=0)
    assert programs[0].exists()
    os.utime(tmp_path / "looked", (1e9, 1e9))
    remove_oldest(tmp_path, most=0)
    assert not programs[0].exists()
