"""Entries of TOML files: what each kind takes, and what is said of everything else."""

import math
import os
import sys

import pytest

from penode.data import toml_file
from penode.data.toml_file import read_toml, require, require_kinds
from penode.errors import InputError

TAKEN = {
    "TEXT": ["", "auto"],
    "FLAG": [True, False],
    "NUMBER": [0, -2.5, math.inf],
    "FACTOR": [1, -2.5, 1e-300],
    "POSITIVE": [1, 1e-300],
    "SIGN": [1, -1],
    "WHOLE": [0, -3],
    "NATURAL": [0, 3],
    "COUNT": [1, 3],
    "NAMES": [[], ["a", "b"]],
    "WHOLES": [[], [6, -12]],
    "TABLE": [{}, {"a": 1}],
}
REFUSED = {
    "TEXT": [1, None],
    "FLAG": [0, 1, "true"],
    "NUMBER": [True, "1"],
    "FACTOR": [0, 0.0, math.inf, -math.inf, math.nan, True],
    "POSITIVE": [0, -1, math.inf, math.nan, True],
    "SIGN": [0, 2, 1.0, -1.0, True],
    "WHOLE": [1.0, True, "1"],
    "NATURAL": [-1, 0.0, False],
    "COUNT": [0, -1, 1.0, True],
    "NAMES": ["a", ["a", 1], ("a",)],
    "WHOLES": [6, [6, 1.0], [True]],
    "TABLE": [[], "a"],
}


@pytest.mark.parametrize("kind", TAKEN)
def test_a_kind_takes_what_it_says_and_nothing_else(kind):
    held = getattr(toml_file, kind)
    for value in TAKEN[kind]:
        require("study.toml: entry", value, held)
    for value in REFUSED[kind]:
        with pytest.raises(InputError) as caught:
            require("study.toml: entry", value, held)
        assert str(caught.value) == f"study.toml: entry = {value!r} came; give {held.words}."


def test_an_unknown_entry_is_told_before_a_wrong_value():
    kinds = {"horizon": toml_file.COUNT, "seed": toml_file.NATURAL}
    require_kinds("study.toml:", {"seed": 0}, kinds)
    with pytest.raises(InputError, match=r"^study.toml: horizn came \(did you mean horizon\?\);"):
        require_kinds("study.toml:", {"seed": -1, "horizn": 3}, kinds)
    with pytest.raises(InputError, match=r"^study.toml: seed = -1 came; give a whole number from"):
        require_kinds("study.toml:", {"seed": -1, "horizon": 0}, kinds)


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"a = ", "not a TOML file"), (b"a = '\xff'", "not UTF-8 text"), (None, "cannot be read")],
)
def test_what_is_no_toml_is_refused_by_name(tmp_path, content, words):
    path = tmp_path / "study.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        read_toml(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_letters_beyond_ascii_are_read(tmp_path):
    path = tmp_path / "study.toml"
    path.write_bytes('"Drehzahl_n [1/min]" = "T_Kühler"'.encode())
    assert read_toml(path) == {"Drehzahl_n [1/min]": "T_Kühler"}


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_toml(path)
    sentence = str(caught.value)
    assert sentence.startswith(f"{path}: ")
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path):
    path = tmp_path / "study.toml"
    path.write_bytes(b"\xef\xbb\xbfseed = 3\n")
    assert read_toml(path) == {"seed": 3}


def test_a_long_file_is_refused(tmp_path):
    (tmp_path / "study.toml").write_bytes(b"# " + b"x" * (1 << 20))
    assert "at most 1048576 bytes, got 1048578" in refusal(tmp_path / "study.toml")


@pytest.mark.skipif(sys.platform == "win32", reason="no such files there")
def test_a_pipe_or_a_device_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "study.toml")
    assert "pipe or a device" in refusal(tmp_path / "study.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    assert "pipe or a device" in refusal(tmp_path / "zero.toml")


@pytest.mark.parametrize("kind", ["FACTOR", "POSITIVE", "WHOLE", "COUNT", "NUMBER"])
def test_a_number_beyond_64_bits_is_none(kind):
    with pytest.raises(InputError, match=r"^study.toml: entry = 10000"):
        require("study.toml: entry", 10**400, getattr(toml_file, kind))
    require("study.toml: entry", 2**63 - 1, getattr(toml_file, kind))


def test_a_long_value_is_cut_in_the_sentence():
    with pytest.raises(InputError) as caught:
        require("study.toml: entry", ["word"] * 10_000, toml_file.NUMBER)
    assert len(str(caught.value)) < 300


# --- what Python's reader does not refuse in a sentence -----------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 2000 + "]" * 2000, "nested too deeply"),
        (".".join(["a"] * 5000) + " = 1", "nested too deeply"),
        ("a = " + "9" * 4301, "a whole number of thousands of digits"),
        (
            "a = " + "9" * 400,
            r"a whole number must have at most 64 bits, got 999999999999\.\.\. \(400 digits\)",
        ),
        ("a = { b = [1, -9223372036854775809] }", "at most 64 bits, got -9223372036854775809"),
    ],
)
def test_what_no_computer_should_read_is_refused(tmp_path, text, words):
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as said:
        read_toml(path)
    assert str(said.value).startswith(f"{path}: ")
    assert len(str(said.value)) < 300


def test_the_largest_whole_numbers_are_read(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text("a = [9223372036854775807, -9223372036854775808]")
    assert read_toml(path) == {"a": [2**63 - 1, -(2**63)]}
