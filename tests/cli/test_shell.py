"""What a shell gets of penode: completion, help with examples, plain text in a pipe."""

import importlib
import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_type_hints

import pytest
from rich.console import Console
from rich.text import Text

from penode.bench.config import shipped_configs
from penode.cli import commands
from penode.cli.console import print_rows
from penode.cli.main import _reflowed, app
from penode.horizon.held_out import PURPOSES
from penode.pmsm.exports.formats import FORMATS
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.term_registry import TERMS

COMMANDS = [command.name for command in app.registered_commands]
TYPED = """
source <(penode --show-completion)
COMP_WORDS=(penode identify run.csv --flux-map ''); COMP_CWORD=4
_penode_completion penode
echo "${COMPREPLY[@]}"
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="No bash on this machine.")
def test_bash_completes_the_names_of_flux_maps():
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", TYPED],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PATH": path},
    )
    assert done.stdout.split() == ["coenergy", "convex", "mlp", "polynomial", "spline"], done.stderr


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("penode ", set(COMMANDS)),
        (
            "penode export result --to ",
            {"csv", "npz", "mat", "motorcad", "syre", "xlsx", "c", "c_fixed", "m", "onnx"},
        ),
        ("penode identify run.csv --purpose s", {"simulation"}),
        ("penode identify run.csv --hold ", {"dq", "stationary"}),
        ("penode simulate w", {"well_designed"}),
    ],
)
def test_words_are_completed(typed, expected, penode, monkeypatch):
    monkeypatch.setenv("_PENODE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split(" ")) - 1))
    assert set(penode().stdout.split()) == expected


@pytest.mark.parametrize("command", COMMANDS)
def test_every_help_has_an_example_that_names_real_options(command, penode):
    text = re.sub(r"[│\s]+", " ", penode(command, "--help").stdout)
    examples = re.findall(rf"Example: penode {command} ([^│╭]*?)(?= Example:| [╭╰─]|$)", text)
    assert examples
    for option in re.findall(r"--[a-z-]+", " ".join(examples)):
        assert text.count(option) >= 2, option


ROWS = [("verdict", Text("good", style="green")), ("warning", "w" * 100), ("warning", "[x]")]


def test_a_pipe_gets_a_line_a_fact_without_colour(capsys):
    print_rows(ROWS, Console())
    assert capsys.readouterr().out.splitlines() == [
        "verdict  good",
        f"warning  {'w' * 100}",
        "warning  [x]",
    ]


@pytest.mark.parametrize("terminal", [False, True])
def test_rows_are_in_line_with_those_above_them(capsys, terminal):
    print_rows([("map", "a.csv")], Console(force_terminal=terminal), below=("validation", "R"))
    assert capsys.readouterr().out.index("a.csv") == (len("validation  ") + 8 * terminal)


def test_a_terminal_gets_colour_and_folded_sentences(capsys):
    print_rows(ROWS, Console(force_terminal=True, width=60, color_system="standard"))
    lines = capsys.readouterr().out.splitlines()
    assert "\x1b[32mgood" in lines[0]
    assert len(lines) == 4
    assert "".join(lines).count("warning") == 1


HEAVY = {"numpy", "jax", "scipy", "matplotlib", "plotly", "penode.paper", "penode.bench"}


@pytest.mark.parametrize(
    ("arguments", "typed"),
    [
        (["--help"], None),
        (["identify", "--help"], None),
        ([], "penode "),
        ([], "penode identify run.csv --flux-map "),
    ],
)
def test_help_and_completion_import_nothing_that_computes(arguments, typed):
    code = (
        f"import sys, penode.cli.main as cli; sys.argv = ['penode', *{arguments}]\n"
        f"try: cli.main()\nfinally: assert not {HEAVY} & set(sys.modules)"
    )
    asked = {"_PENODE_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": ""}
    if typed is not None:
        asked["COMP_CWORD"] = str(len(typed.split(" ")) - 1)
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **(asked if typed is not None else {})},
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.split()) >= 5


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_typed_is_what_the_work_is_given(command):
    """The pages of help stand apart from the work; names and types are the same in both."""
    work = getattr(importlib.import_module(f"penode.cli.{command}"), f"{command}_command")
    typed = getattr(commands, command)
    assert get_type_hints(typed) == get_type_hints(work)
    assert list(inspect.signature(typed).parameters) == list(inspect.signature(work).parameters)


def test_choices_of_the_pages_of_help_are_those_of_the_registries():
    assert list(FLUX_MAPS) == list(commands._FLUX_MAPS)
    assert list(TERMS) == list(commands._TERMS)
    assert list(HOLDS) == list(commands._HOLDS)
    assert list(PURPOSES) == list(commands._PURPOSES)
    assert list(FORMATS) == list(commands._FORMATS)
    assert list(shipped_configs()) == list(commands._SIMULATIONS)


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        (("identfy", "run.csv"), "no such command 'identfy', did you mean 'identify'; see penode "),
        (("check", "--jsn", "run.csv"), "no such option: --jsn"),
        (("identify", "run.csv"), "missing option '--out'; see penode identify --help."),
        (("identify", "run.csv", "--out", "o", "--seed", "one"), "value for '--seed'"),
        (("init", "run.csv", "more.csv"), "(more.csv); see penode init --help."),
    ],
)
def test_wrong_usage_is_refused_in_one_sentence(typed, words, penode):
    done = penode(*typed)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: ")
    assert words in done.stderr
    assert done.stderr.endswith(" --help.\n")
    assert done.stderr.count("\n") == 1


def test_a_paragraph_of_help_has_no_line_ends_of_its_own():
    assert _reflowed("a\n    b\n\n    c") == "a b\n\nc"
    assert all("\n" not in one for c in app.registered_commands for one in c.help.split("\n\n"))


def test_no_words_at_all_show_the_help(penode):
    done = penode()
    assert done.returncode == 2
    assert "identify" in done.stdout + done.stderr
    assert "error" not in done.stderr
