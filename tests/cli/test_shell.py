"""What a shell gets of penode: completion, help with examples, plain text in a pipe."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from rich.text import Text

from penode.cli.console import print_rows
from penode.cli.main import _reflowed, app

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


def test_commands_start_without_what_few_of_them_need():
    """A plotting library takes a third of a second, and few commands draw."""
    few = {"matplotlib", "plotly", "penode.paper"}
    code = f"import sys, penode.cli.main; sys.exit(bool({few!r} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], timeout=120).returncode == 0


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
