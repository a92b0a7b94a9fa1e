"""The campaign: how a log's end becomes a record, and the table's figures."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from validate.command import Ended
from validate.drawn_logs import BENCH, PLANT, DrawnLog
from validate.sampled_drive.kinds import HELD_OUT, KINDS, draw

from penode.horizon.consensus import LEFT_OUT
from validate import drawn_logs, through_command


def too_short(_number: int, folder: Path) -> DrawnLog:
    file = folder / "log.csv"
    folder.mkdir(parents=True)
    draw("drone at 40 kHz", 0).logs[0].rows(slice(3)).write(file)
    return DrawnLog(PLANT, "drone at 40 kHz", 0, (file,), 1.0, refuse=False)


def ended(status: int, printed: str = "", warned: tuple[str, ...] = ()) -> Ended:
    return Ended(status, printed, warned, 3.0)


def record(draw: int, **changed: object) -> dict[str, object]:
    found = {
        "draw": draw, "simulator": PLANT, "kind": "clean", "seed": 1000, "refuse": False,
        "truth": 2.0, "status": 0, "traceback": False, "warned": [], "seconds": 10.0,
        "result": True, "verdict": "plateau", "positive": True, "why": "agree", "objections": [],
        "R": 2.02, "interval": [1.9, 2.1], "covered": True,
    }  # fmt: skip
    return found | changed


def test_a_recording_that_is_refused_leaves_a_record_and_no_files(tmp_path, monkeypatch):
    monkeypatch.setattr(through_command, "FOLDER", tmp_path)
    one = through_command.result_of(too_short, 7)
    assert (one["status"], one["traceback"], one["result"]) == (2, False, False)
    assert "row" in one["why"] or "samples" in one["why"]
    assert not any(tmp_path.iterdir())


def test_exit_status_70_and_a_warning_of_numpy_are_noted():
    log = DrawnLog(PLANT, "clean", 0, (), 1.0, refuse=False)
    crashed = through_command.outcome(ended(70, "internal error"), log)
    warned = ("RuntimeWarning: overflow (a.py:3)", "UserWarning: something")
    noted = through_command.outcome(ended(2, "cannot", warned), log)
    assert crashed["traceback"]
    assert not noted["traceback"]
    assert noted["warned"] == ["RuntimeWarning: overflow (a.py:3)"]
    assert "TRACEBACK" in through_command.line_of({**record(0), **crashed})


def test_an_estimate_without_an_end_is_noted(tmp_path):
    horizon = {"verdict": "no plateau", "reason": "none", "objections": []}
    estimate = {"value": None, "interval_95": [None, None]}
    answer = {"horizon": horizon, "parameters": {"R": estimate}}
    (tmp_path / "result.json").write_text(json.dumps(answer))
    log = DrawnLog(PLANT, "clean", 0, (), 1.0, refuse=False)
    found = through_command.outcome(Ended(1, "", (), 3.0, tmp_path), log)
    assert found["result"]
    assert not found["covered"]
    assert "nan" in through_command.line_of({**record(0), **found})


def test_the_table_counts_what_went_wrong(capsys):
    missed = {"covered": False, "R": 2.4, "kind": "jitter of the stamps"}
    refusal = {"positive": False, "result": False, "status": 2, "seconds": 20.0}
    wrong = {"kind": "noise alone", "refuse": True, "truth": None, "covered": False}
    draws = [record(0), record(1), record(2, **missed), record(3, **refusal), record(4, **wrong)]
    draws.append(record(5, status=70, traceback=True, result=False, positive=False))
    draws.append(record(6, status=1, result=False, positive=False, warned=["RuntimeWarning: x"]))
    through_command.print_table(draws)
    table = capsys.readouterr().out
    assert "exit status 0: 4, 1: 1, 2: 1, 70: 1" in table
    assert "tracebacks 1\n" in table
    assert "with a RuntimeWarning 1\n" in table
    assert "exit status 0 or 1 without result.json 1\n" in table
    assert "all: 4 of 7 positive (3 of the 6 that have an answer, 50 %)" in table
    assert "covered 2 of 4 (50 %); largest error 20.00 %" in table
    assert "positive on a log that has no answer 1" in table
    assert "refused before training: 3, median 10.0 s, longest 20.0 s, 1 took over 15 s" in table


def test_what_the_model_leaves_out_widens_by_the_whole_over_the_rest(capsys):
    rows = [("a", 3.0), (LEFT_OUT, 4.0), ("b", 0.0)]
    budget = [{"source": source, "std": std} for source, std in rows]
    assert through_command.widened(budget) == pytest.approx(5 / 3)
    assert through_command.widened(budget[:1]) == 1.0
    assert np.isnan(through_command.widened([{"source": "a", "std": None}]))
    through_command.print_table([record(0, widened=1.0), record(1, widened=1.5), record(2)])
    assert "widens R by 1.25 in the median" in capsys.readouterr().out


def test_half_of_the_logs_are_the_plant_s_all_kinds_at_held_out_seeds(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        drawn_logs, "of_kind", lambda kind, seed, _folder: drawn.append((kind, seed))
    )
    for number in range(0, 4 * len(KINDS), 2):
        drawn_logs.draw_log(number, tmp_path)
    assert [kind for kind, _ in drawn] == [*KINDS, *KINDS]
    assert {seed for _, seed in drawn} == {HELD_OUT, HELD_OUT + 1}


def test_without_recordings_of_other_simulators_the_bench_stands_in(tmp_path, monkeypatch):
    monkeypatch.setattr(drawn_logs, "OTHERS", tmp_path / "none")
    assert drawn_logs.recorded_elsewhere() == []
    log = drawn_logs.draw_log(7, tmp_path)
    assert log.simulator == BENCH
    assert log.kind in drawn_logs.CHANGES
    assert all(file.exists() for file in log.files)


def test_seeds_held_out_are_refused_for_developing(monkeypatch, capsys):
    asked = ["through_command", "--developing", str(HELD_OUT)]
    monkeypatch.setattr(through_command.argparse._sys, "argv", asked)
    with pytest.raises(SystemExit):
        through_command.main()
    assert "held out" in capsys.readouterr().err


def test_a_log_for_developing_is_of_the_kind_that_its_number_names(tmp_path):
    number = list(KINDS).index("dc machine")
    log = partial(through_command.developing, 5)(number, tmp_path)
    assert (log.kind, log.seed, log.refuse) == ("dc machine", 5, True)
