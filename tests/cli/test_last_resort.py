"""Failures that no command expects: a sentence, an exit status of their own, a file to send."""

import re
from pathlib import Path

import pytest

from penode.cli.console import why_and_status
from penode.fit.result_folder import claimed

GIVE = "give another place.\n"
RUN = "t,u_d,u_q,i_d,i_q,omega_el\n0,1,2,3,4,5\n"


def long_run():
    """Return the text of a recording that is refused only when it is looked at."""
    row = RUN.splitlines()[1][1:]
    return RUN + "".join(f"{k / 1e4}{row}\n" for k in range(1, 20))


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(RUN)
    return path


def failing(error):
    def load(*_args, **_kwargs):
        raise error

    return load


def test_a_failure_of_penode_names_a_file_with_its_details(penode, run, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("penode.cli.check.load_studies", failing(RuntimeError("no\nsense")))
    done = penode("check", run)
    assert done.returncode == 70
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    path = Path(re.search(r"send in (\S+),", done.stderr)[1])
    details = path.read_text()
    assert "RuntimeError: no\nsense" in details
    assert f"check {run}" in details


def test_details_that_cannot_be_written_are_told(penode, run, monkeypatch):
    monkeypatch.setattr("penode.cli.check.load_studies", failing(RuntimeError("no sense")))
    monkeypatch.setattr("tempfile.mkstemp", failing(OSError(28, "No space left on device")))
    done = penode("check", run)
    assert done.returncode == 70
    assert "no details could be written" in done.stderr


def test_a_file_that_cannot_be_written_is_the_users_to_mend(penode, run, monkeypatch):
    full = OSError(28, "No space left on device", "result.json")
    monkeypatch.setattr("penode.cli.check.load_studies", failing(full))
    done = penode("check", run)
    assert done.returncode == 2
    assert done.stderr.startswith("error: result.json: no space left on device; ")


def test_what_does_not_fit_into_the_memory_is_the_users_to_mend(penode, run, monkeypatch):
    big = MemoryError("Unable to allocate 7 TiB")
    monkeypatch.setattr("penode.cli.check.load_studies", failing(big))
    done = penode("check", run)
    assert done.returncode == 2
    assert done.stderr.startswith("error: not enough memory (Unable to allocate 7 TiB); ")


def test_an_output_folder_that_is_a_file(penode, run, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    run.write_text(long_run())
    done = penode("identify", run, "--out", taken)
    assert done.returncode == 2
    assert taken.read_text() == "mine"
    assert done.stderr == f"error: {taken}: a file is there where a folder was wanted; {GIVE}"


def test_the_demo_says_nothing_before_it_has_its_folder(penode, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    assert len(penode("demo", "--out", taken).stderr.splitlines()) == 1


@pytest.mark.parametrize("command", ["identify", "sweep", "demo"])
def test_a_folder_in_which_another_process_writes(penode, run, tmp_path, command):
    out = tmp_path / "out"
    run.write_text(long_run())
    recordings = () if command == "demo" else (run,)
    with claimed(out):
        done = penode(command, *recordings, "--out", out)
        assert {path.name for path in out.iterdir()} == {".lock"}
    assert done.returncode == 2
    sentence = f"error: {out}: another process of penode writes there; "
    assert done.stderr.splitlines()[-1].startswith(sentence)


def test_the_sentence_without_a_name_still_says_why():
    sentence, status = why_and_status(OSError("the disk is gone"))
    assert status == 2
    assert sentence.startswith("the disk is gone; ")
