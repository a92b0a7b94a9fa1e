"""A sweep whose identifications are given: what is kept, what is done again, what is written."""

import json
import shutil
from pathlib import Path

import polars as pl
import pytest

from penode.errors import InputError
from penode.pmsm.study_file import StudyFile
from penode.pmsm.study_settings import Study
from penode.pmsm.sweep.campaign import Campaign, Recorded
from penode.pmsm.sweep.run import sweep
from penode.pmsm.sweep.table import LABELS, LINES, PARQUET, TIMES, read_table
from penode.pmsm.sweep.task import Outcome, failed, run


class Given:
    """Workers that answer at once, the last task first, and write down which tasks came."""

    def __init__(self, answer=None):
        self.came, self.answer = [], answer or self.estimate

    def __call__(self, tasks):
        every = list(tasks)
        self.came += [Path(task.files[0]).name for task in every]
        for task in reversed(every):
            yield task, self.answer(task)

    @staticmethod
    def estimate(task):
        value = len(task.files[0]) / 7 + task.asked.study.seed / 3
        values = {"status": "done", "verdict": "plateau", "answered": True, "R": value}
        times = {"seconds": 1.0, "processor_seconds": 1.0}
        return Outcome({**values, **times, "bearing": 2.0}, {"fit/fit.json": task.key.encode()})


@pytest.fixture
def campaign(tmp_path):
    for name in "abc":
        (tmp_path / f"{name}.csv").write_text(name)
    return Campaign(tuple(recorded(tmp_path, name) for name in "abc"), seeds=(0, 1))


def recorded(folder, name, machine=None):
    return Recorded(f"{name}.csv", (folder / f"{name}.csv",), machine)


def done(campaign, folder, workers):
    folder.mkdir(exist_ok=True)
    return list(sweep(campaign, folder, workers))


def untimed(folder):
    return pl.read_parquet(folder / PARQUET).drop(TIMES)


def test_the_table_is_in_the_order_of_the_campaign(campaign, tmp_path):
    rows = done(campaign, tmp_path / "out", Given())
    assert [row["recording"] for row in rows] == [
        "c.csv",
        "c.csv",
        "b.csv",
        "b.csv",
        "a.csv",
        "a.csv",
    ]
    table = pl.read_parquet(tmp_path / "out" / PARQUET)
    assert table.select(LABELS).rows(named=True) == list(campaign.labels())
    assert table["bearing"].to_list() == [2.0] * 6
    for key in table["key"]:
        assert (tmp_path / "out" / "fits" / key / "fit" / "fit.json").read_text() == key
    lines = (tmp_path / "out" / LINES).read_text().splitlines()
    assert [json.loads(line)["R"] for line in lines] == [row["R"] for row in rows]
    assert {row["R"] for row in rows} == set(table["R"])


def test_nothing_is_done_twice(campaign, tmp_path):
    done(campaign, tmp_path / "out", Given())
    before = (tmp_path / "out" / LINES).read_bytes()
    workers = Given()
    assert len(done(campaign, tmp_path / "out", workers)) == 6
    assert workers.came == []
    assert (tmp_path / "out" / LINES).read_bytes() == before


def test_what_is_added_is_done_alone(campaign, tmp_path):
    done(Campaign(campaign.recordings[:2], seeds=(0, 1)), tmp_path / "out", Given())
    workers = Given()
    done(campaign, tmp_path / "out", workers)
    assert workers.came == ["c.csv", "c.csv"]
    done(campaign, tmp_path / "whole", Given())
    assert untimed(tmp_path / "out").equals(untimed(tmp_path / "whole"))


def test_a_recording_named_anew_is_a_row_of_the_same_task(campaign, tmp_path):
    done(campaign, tmp_path / "out", Given())
    named = tuple(recorded(tmp_path, name, machine=f"M{name}") for name in "abc")
    workers = Given()
    done(Campaign(named, seeds=(0, 1)), tmp_path / "out", workers)
    assert workers.came == []
    table = read_table(tmp_path / "out")
    assert table["machine"].to_list() == ["Ma", "Ma", "Mb", "Mb", "Mc", "Mc"]
    done(campaign, tmp_path / "out", workers)
    assert read_table(tmp_path / "out")["machine"].null_count() == 6


def test_two_variants_that_are_the_same_are_done_once(tmp_path, campaign):
    both = {"one": StudyFile(), "other": StudyFile(), "third": StudyFile(Study(hold="dq"))}
    workers = Given()
    rows = done(Campaign(campaign.recordings[:1], both), tmp_path / "out", workers)
    assert len(workers.came) == 2
    assert sorted(row["variant"] for row in rows) == ["one", "other", "third"]


def test_a_last_line_that_was_cut_off_is_done_again(campaign, tmp_path):
    done(campaign, tmp_path / "whole", Given())
    lines = (tmp_path / "whole" / LINES).read_bytes()
    for end in range(0, len(lines), 97):
        out = tmp_path / "out"
        shutil.copytree(tmp_path / "whole", out, dirs_exist_ok=True)
        (out / PARQUET).unlink()
        (out / LINES).write_bytes(lines[:end])
        (out / "fits" / ".abc.part").mkdir()
        workers = Given()
        done(campaign, out, workers)
        assert len(workers.came) == 6 - lines[:end].count(b"\n")
        assert untimed(out).equals(untimed(tmp_path / "whole"))
        assert not list(out.rglob(".*"))


def test_what_was_refused_stays_and_what_failed_is_tried_again(campaign, tmp_path):
    def answer(task):
        name = Path(task.files[0]).stem
        if name == "a":
            return Outcome({"status": "refused", "error": "No column t."})
        return failed("The memory does not suffice.") if name == "b" else Given.estimate(task)

    rows = done(campaign, tmp_path / "out", Given(answer))
    assert {row["error"] for row in rows if "error" in row} == {
        "No column t.",
        "The memory does not suffice.",
    }
    workers = Given()
    done(campaign, tmp_path / "out", workers)
    assert workers.came == ["b.csv", "b.csv"]
    table = read_table(tmp_path / "out")
    assert table["status"].to_list() == ["refused", "refused", "done", "done", "done", "done"]


def test_the_table_can_be_read_while_it_grows(campaign, tmp_path):
    (tmp_path / "out").mkdir()
    seen = []
    for _ in sweep(campaign, tmp_path / "out", Given()):
        with (tmp_path / "out" / LINES).open("rb") as lines:
            assert lines.read().endswith(b"\n")
        seen.append(len(read_table(tmp_path / "out")))
    assert seen == [1, 2, 3, 4, 5, 6]


def test_numbers_survive_to_the_last_bit(tmp_path, campaign):
    value = 0.1 + 0.2
    answer = lambda task: Outcome({"status": "done", "R": value, "rmse": float("nan")})  # noqa: E731
    done(campaign, tmp_path / "out", Given(answer))
    table = read_table(tmp_path / "out")
    assert set(table["R"]) == {value}
    assert table["rmse"].null_count() == 6


@pytest.mark.parametrize("line", ["{", "[]", '{"key": "a"}', "\xff"])
def test_a_damaged_table_is_refused_in_one_sentence(campaign, tmp_path, line):
    done(campaign, tmp_path / "out", Given())
    path = tmp_path / "out" / LINES
    path.write_bytes(line.encode("latin-1") + b"\n" + path.read_bytes())
    with pytest.raises(InputError, match="line 1 is not as it was written"):
        done(campaign, tmp_path / "out", Given())
    with pytest.raises(InputError, match="line 1 is not as it was written"):
        read_table(tmp_path / "out")


def test_no_table_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"table\.jsonl: no such file"):
        read_table(tmp_path)


def task_of(campaign):
    return next(campaign.planned()).task


def test_a_recording_that_cannot_be_used_is_refused(campaign):
    outcome = run(task_of(campaign))
    assert outcome.values["status"] == "refused"
    assert "a.csv" in outcome.values["error"]
    assert not outcome.files


def test_a_file_that_changed_since_is_tried_again(campaign, tmp_path, monkeypatch):
    task = task_of(campaign)
    rows = "\n".join(f"{k / 1e3},1,1,{k % 3},{k % 5},1" for k in range(20))
    (tmp_path / "a.csv").write_text(f"t,u_d,u_q,i_d,i_q,omega_el\n{rows}\n")
    values = run(task).values
    assert values["status"] == "failed"
    assert values["error"] == "a.csv: the file changed during the sweep; start it again."


def test_another_version_of_the_code_is_not_taken_for_the_same(campaign, monkeypatch):
    task = task_of(campaign)
    monkeypatch.setattr("penode.pmsm.sweep.task.code_version", lambda: "another")
    values = run(task).values
    assert values["status"] == "failed"
    assert "another version" in values["error"]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError("8 GB"), "Not enough memory (8 GB)"),
        (ZeroDivisionError("a\nb"), "Internal error of penode (ZeroDivisionError: a b)."),
    ],
)
def test_a_failure_is_a_row_with_its_sentence(campaign, monkeypatch, error, words):
    def fail(*_):
        raise error

    monkeypatch.setattr("penode.pmsm.sweep.task._identified", fail)
    values = run(task_of(campaign)).values
    assert values["status"] == "failed"
    assert words in values["error"]
