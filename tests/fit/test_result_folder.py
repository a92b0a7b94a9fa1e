"""A result is replaced as one, by one process at a time, whatever ends the others."""

import json
import os
import signal
import warnings
from pathlib import Path

import pytest

from penode.errors import InputError
from penode.fit.result_folder import claimed, digests, replace_together, require_one_result

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="No locks on this system.")


def files(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_text() for p in folder.rglob("*") if p.is_file()
    }


def result(version):
    """Return the files of a small result."""
    made = {"fit/fit.json": f"fit {version}".encode(), "flux_map.csv": f"map {version}".encode()}
    text = json.dumps({"version": version, "files": digests(made)})
    return {**made, "result.json": text.encode()}


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a result and a file of the user's own."""
    folder = tmp_path / "out"
    with claimed(folder):
        replace_together(folder, result("old"))
    (folder / "notes.txt").write_text("mine")
    return folder


def write(folder):
    with claimed(folder):
        replace_together(folder, result("new"))


def of(version):
    return {**{name: content.decode() for name, content in result(version).items()}}


NOTES = {"notes.txt": "mine"}


def test_nothing_but_the_files_is_left(folder):
    assert files(folder) == of("old") | NOTES
    write(folder)
    assert files(folder) == of("new") | NOTES
    require_one_result(folder)


# --- interruption -----------------------------------------------------------------------------


def forked(work):
    """Start a process that does the work, and return its number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of threads: the process writes files and ends
        process = os.fork()
    if process == 0:
        try:
            work()
        finally:
            os._exit(0)
    return process


def kill_at(step):
    """Kill this process at the n-th file that it writes, renames or moves."""
    steps = iter(range(1, 100))

    def dying(whole):
        def replaced(path, *rest):
            if next(steps) == step:
                os.kill(os.getpid(), signal.SIGKILL)
            return whole(path, *rest)

        return replaced

    for name in ("write_bytes", "rename", "replace"):
        setattr(Path, name, dying(getattr(Path, name)))


@pytest.mark.parametrize(
    ("step", "left"), [*((n, "old") for n in range(1, 5)), (5, "new"), (7, "new")]
)
def test_a_kill_at_any_step_leaves_one_result_to_the_next_reader(folder, step, left):
    """Three files are written, one step commits them, three are moved."""

    def work():
        kill_at(step)
        write(folder)

    _, status = os.waitpid(forked(work), 0)
    assert os.WTERMSIG(status) == signal.SIGKILL
    require_one_result(folder)
    assert {k: v for k, v in files(folder).items() if k in of("old")} == of(left)
    with claimed(folder):
        pass
    assert files(folder) == of(left) | NOTES


@pytest.mark.parametrize("step", range(1, 9))
def test_a_kill_at_any_step_leaves_no_report_beside_the_result_of_another(folder, step):
    """Before the first file of the new result is moved to its place, that report is removed."""
    (folder / "report.html").write_text("report old")

    def work():
        kill_at(step)
        write(folder)

    os.waitpid(forked(work), 0)
    require_one_result(folder)
    left = json.loads((folder / "result.json").read_text())["version"]
    assert left == ("old" if step < 5 else "new")
    assert (folder / "report.html").exists() == (left == "old")


def test_files_of_no_result_leave_the_report(folder):
    (folder / "report.html").write_text("report old")
    with claimed(folder):
        replace_together(folder, {"notes.txt": b"other"})
    assert (folder / "report.html").exists()


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_writing_that_fails_leaves_the_old_result(folder, monkeypatch, error):
    whole = Path.write_bytes

    def fail(path, content):
        if path.name == "flux_map.csv":
            raise error
        return whole(path, content)

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(type(error)):
        write(folder)
    assert files(folder) == of("old") | NOTES
    assert getattr(error, "filename", "") in ("", str(folder / "flux_map.csv"))


def test_ctrl_c_after_the_commit_leaves_the_new_result(folder, monkeypatch):
    whole, moved = Path.replace, []

    def fail(path, target):
        moved.append(target)
        if len(moved) == 2:
            raise KeyboardInterrupt
        return whole(path, target)

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(KeyboardInterrupt):
        write(folder)
    assert files(folder) == of("new") | NOTES


# --- two processes ----------------------------------------------------------------------------


def test_a_folder_in_which_another_process_writes_is_refused(folder):
    there, here = os.pipe()

    def work():
        with claimed(folder):
            os.write(here, b"claimed")
            signal.pause()

    other = forked(work)
    assert os.read(there, 7) == b"claimed"
    with pytest.raises(InputError, match=rf"^{folder}: another process of penode writes"):
        write(folder)
    assert {k: v for k, v in files(folder).items() if k != ".lock"} == of("old") | NOTES
    os.kill(other, signal.SIGKILL)
    os.waitpid(other, 0)
    write(folder)  # the claim of a dead process is none
    assert files(folder) == of("new") | NOTES


def test_a_claim_without_files_leaves_no_folder(tmp_path):
    with pytest.raises(RuntimeError), claimed(tmp_path / "a" / "b"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_was_there_stays(tmp_path):
    with claimed(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


# --- files of several results -----------------------------------------------------------------


@pytest.mark.parametrize("name", ["fit/fit.json", "flux_map.csv"])
def test_a_file_of_another_result_is_refused_by_name(folder, name):
    (folder / name).write_text("of another")
    with pytest.raises(InputError, match=rf"^{folder}/{name}: not the file that result.json"):
        require_one_result(folder)


def test_without_digests_nothing_is_examined(folder):
    (folder / "flux_map.csv").unlink()
    require_one_result(folder)
    (folder / "result.json").write_text("{}")
    require_one_result(folder)
    (folder / "result.json").unlink()
    require_one_result(folder)


@pytest.mark.parametrize("text", ["", "[]", '{"files": 3}', "[" * 100_000])
def test_a_damaged_result_is_refused(folder, text):
    (folder / "result.json").write_text(text)
    with pytest.raises(InputError, match=r"result\.json: not as it was written"):
        require_one_result(folder)
