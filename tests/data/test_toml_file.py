"""Entries of TOML files: what each kind takes, and what is said of everything else."""

import math
import os
import sys
from typing import Literal

import msgspec
import pytest

from penode.data.toml_file import COUNT, FINITE, NATURAL, POSITIVE, held_against, read_toml
from penode.errors import InputError

TAKEN = [
    (str, ["", "auto"]),
    (bool, [True, False]),
    (float, [0, -2.5, math.inf]),
    (FINITE, [0, -2.5, sys.float_info.max]),
    (POSITIVE, [1, 1e-300]),
    (int, [0, -3]),
    (NATURAL, [0, 3]),
    (COUNT, [1, 3]),
    (list[str], [[], ["a", "b"]]),
    (tuple[float, float], [[0, 1.5]]),
    (Literal[1, -1], [1, -1]),
    (dict[str, int], [{}, {"a": 1}]),
]
REFUSED = [
    (str, [1, None], "text"),
    (bool, [0, 1, "true"], "true or false"),
    (float, [True, "1"], "a number"),
    (FINITE, [math.inf, -math.inf, math.nan, True, 10**400], "a finite number"),
    (POSITIVE, [0, -1, math.inf, math.nan, True], "a finite number > 0"),
    (int, [1.0, True, "1"], "a whole number"),
    (NATURAL, [-1, 0.0, False], "a whole number >= 0"),
    (COUNT, [0, -1, 1.0, True], "a whole number >= 1"),
    (list[str], ["a", 3], "a list, each item text"),
    (tuple[float, float], [[1], 3], "a list of 2"),
    (Literal[1, -1], [0, 2, 1.0, True], "-1 or 1"),
    (dict[str, int], [[], "a"], "a table"),
    (int | Literal["auto"], ["a"], "a whole number or 'auto'"),
    (str | None, [3], "text"),
]


def read_as(kind, value):
    schema = msgspec.defstruct("File", [("entry", kind)], forbid_unknown_fields=True)
    return held_against(schema, {"entry": value}, "study.toml: ").entry


@pytest.mark.parametrize(("kind", "values"), TAKEN)
def test_a_schema_takes_what_it_says(kind, values):
    for value in values:
        taken = read_as(kind, value)
        assert list(taken) == value if isinstance(taken, tuple) else taken == value


@pytest.mark.parametrize(("kind", "values", "words"), REFUSED)
def test_and_nothing_else(kind, values, words):
    for value in values:
        with pytest.raises(InputError) as caught:
            read_as(kind, value)
        start = f"study.toml: entry must be {words}, got {value!r}."
        assert str(caught.value).startswith(start[:200])


class Ramp(msgspec.Struct, tag="ramp", tag_field="kind", forbid_unknown_fields=True):
    rates: list[int]


class Step(msgspec.Struct, tag="step", tag_field="kind", forbid_unknown_fields=True):
    size: float

    def __post_init__(self):
        if self.size == 0:
            raise ValueError("size must not be 0.")


class File(msgspec.Struct, forbid_unknown_fields=True):
    move: Ramp | Step
    seed: int = 0


@pytest.mark.parametrize(
    ("entries", "sentence"),
    [
        ({"moev": {}}, "moev is unknown (did you mean move?); known are move, seed."),
        ({}, "move is missing; it must be a table with kind = 'ramp' or 'step'."),
        ({"move": 3}, "move must be a table with kind = 'ramp' or 'step', got 3."),
        ({"move": {}}, "move.kind is missing; it must be 'ramp' or 'step'."),
        ({"move": {"kind": "stp"}}, "move.kind must be 'ramp' or 'step', got 'stp'."),
        ({"move": {"kind": "step"}}, "move.size is missing; it must be a number."),
        (
            {"move": {"kind": "ramp", "rate": 3, "rates": []}},
            "move.rate is unknown (did you mean rates?); known are rates.",
        ),
        (
            {"move": {"kind": "ramp", "rates": [3, "a"]}},
            "move.rates[1] must be a whole number, got 'a'.",
        ),
        ({"move": {"kind": "step", "size": 0}}, "move: size must not be 0."),
    ],
)
def test_the_place_in_nested_tables_is_named(entries, sentence):
    with pytest.raises(InputError) as caught:
        held_against(File, entries, "study.toml: ")
    assert str(caught.value) == f"study.toml: {sentence}"


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
    assert "got 1048578" in refusal(tmp_path / "study.toml")


@pytest.mark.skipif(sys.platform == "win32", reason="no such files there")
def test_a_pipe_or_a_device_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "study.toml")
    assert "pipe or a device" in refusal(tmp_path / "study.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    assert "pipe or a device" in refusal(tmp_path / "zero.toml")


def test_a_long_value_is_cut_in_the_sentence():
    with pytest.raises(InputError) as caught:
        read_as(float, ["word"] * 10_000)
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
            r"must have at most 64 bits, got 999999999999\.\.\. \(400 digits\)",
        ),
        (
            "a = { b = [1, -9223372036854775809] }",
            "must have at most 64 bits, got -9223372036854775809",
        ),
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
