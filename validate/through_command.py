"""Drawn logs through the command, report and exit status included.

``python -m validate.through_command [COUNT] [FIRST] [--jobs 2]``: logs FIRST to FIRST + COUNT of
`validate.drawn_logs` are written to files and identified by ``penode identify`` with nothing given
beside, in processes that are begun anew every 25 logs. ``--developing SEED`` identifies one log of
each kind of `validate.sampled_drive` at a seed below 1000 instead, ``--kind NAME`` that kind
alone. What became of each is kept in ``out/validate/through_command.jsonl``; delete it after a
change. Ctrl-C prints the table so far; the same command goes on.
"""

import argparse
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Any

import numpy as np

from penode.fit.outcome import AGREED
from penode.horizon.consensus import LEFT_OUT
from validate.command import Ended, identify
from validate.drawn_logs import DrawnLog, draw_log, of_kind, recorded_elsewhere
from validate.ledger import Ledger, Record
from validate.other_simulators.table import map_error
from validate.sampled_drive.kinds import HELD_OUT, KINDS

COUNT = 500
FOLDER = Path("out") / "validate" / "through_command"
#: Logs that one process identifies: what JAX keeps of each adds up.
_BATCH = 25
#: Objections and verdicts that ``check`` can reach end within these seconds.
SOON = 15.0

Draw = Callable[[int, Path], DrawnLog]


def result_of(draw: Draw, number: int) -> Record:
    """Write a log, identify it and return what became of it; the files are deleted."""
    folder = FOLDER / str(number)
    shutil.rmtree(folder, ignore_errors=True)
    log = draw(number, folder)
    ended = identify(log.files, folder / "result")
    record = {"simulator": log.simulator, "kind": log.kind, "seed": log.seed}
    record |= {"refuse": log.refuse, "truth": log.resistance, **outcome(ended, log)}
    shutil.rmtree(folder)
    return record


def outcome(ended: Ended, log: DrawnLog) -> dict[str, Any]:
    """Return how the command ended, as what JSON can hold."""
    warned = [line for line in ended.warned if line.startswith("RuntimeWarning")]
    record: dict[str, Any] = {
        "status": ended.status,
        "traceback": ended.status == 70 or "Traceback" in ended.printed,
        "warned": sorted(set(warned)),
        "seconds": ended.seconds,
        "result": ended.result is not None,
        "verdict": "refused",
        "why": ended.last_line,
    }
    if ended.result is None:
        return record
    horizon, estimate = ended.result["horizon"], ended.result["parameters"]["R"]
    # What is no number is null in the file.
    value, low, high = (
        np.nan if number is None else number
        for number in (estimate["value"], *estimate["interval_95"])
    )
    positive = horizon["verdict"] in AGREED and ended.status == 0
    record |= {
        "verdict": horizon["verdict"],
        "positive": positive,
        "why": horizon["reason"],
        "objections": [one["name"] for one in horizon["objections"]],
        "R": value,
        "interval": [low, high],
        "covered": log.resistance is not None and low <= log.resistance <= high,
        "widened": widened(estimate.get("budget", ())),
    }
    if positive and log.flux_map and not log.refuse:
        fit = ended.fit()
        record["map"] = map_error(fit, log.flux_map, fit.supported)
    return record


def widened(budget: Sequence[Mapping[str, Any]]) -> float:
    """Return the deviation of R over what it is without the row of what the model leaves out."""
    known = {row["source"]: np.nan if row["std"] is None else row["std"] for row in budget}
    squares = {source: std**2 for source, std in known.items()}
    whole = sum(squares.values())
    rest = whole - squares.get(LEFT_OUT, 0.0)
    return float(np.sqrt(whole / rest)) if rest > 0 else np.nan


def is_positive(one: Record) -> bool:
    """Whether an answer was given and called trustworthy."""
    return bool(one.get("positive"))


def error_of(one: Record) -> float:
    """Return the error of R in per cent, infinite without a truth."""
    return 100 * (one["R"] / one["truth"] - 1) if one["truth"] else np.inf


def line_of(one: Record) -> str:
    """Return the line of a log."""
    head = f"{one['draw']:4d} {one['simulator']:18.18s} {one['kind']:28.28s} {one['status']:3d}"
    if one["result"]:
        low, high = one["interval"]
        half = 100 * (high - low) / 2 / max(abs(one["R"]), 1e-30)
        known = f"{one['truth']:.4g}" if one["truth"] else "-"
        head += f" R {one['R']:.4g} +- {half:.2g} % ({known}; {error_of(one):+.2f} %)"
        if is_positive(one):
            right = one["covered"] and not one["refuse"]
            head += " right" if right else " ANSWERED" if one["refuse"] else " MISSED"
    said = ", ".join(dict.fromkeys(one.get("objections", ()))) or one["verdict"]
    said = one["why"] if one["verdict"] == "refused" else said
    noted = " TRACEBACK" * one["traceback"] + " RuntimeWarning" * bool(one["warned"])
    return f"{head}{noted} {one['seconds']:.0f} s: {said[:150]}"


def print_table(draws: Sequence[Record]) -> None:
    """Print what became of all, then of each simulator and kind."""
    if not draws:
        return
    statuses = Counter(one["status"] for one in draws)
    lacking = sum(one["status"] in (0, 1) and not one["result"] for one in draws)
    told = ", ".join(f"{status}: {count}" for status, count in sorted(statuses.items()))
    print(f"\n{len(draws)} logs; exit status {told}")
    print(f"tracebacks {sum(one['traceback'] for one in draws)}")
    print(f"with a RuntimeWarning {sum(bool(one['warned']) for one in draws)}")
    print(f"exit status 0 or 1 without result.json {lacking}")
    for simulator in dict.fromkeys(one["simulator"] for one in draws):
        print(summary(simulator, [one for one in draws if one["simulator"] == simulator]))
    print(summary("all", draws))
    before = [one["seconds"] for one in draws if not one["result"]]
    after = [one["seconds"] for one in draws if one["result"] and not is_positive(one)]
    wider = [one["widened"] for one in draws if is_positive(one) and "widened" in one]
    if wider:
        middle, high = np.nanquantile(wider, [0.5, 0.9])
        print(f"{LEFT_OUT} widens R by {middle:.2f} in the median, by {high:.2f} in one of ten")
    print(_times("refused before training", before))
    print(_times("not positive after training", after))
    print(_times("positive", [one["seconds"] for one in draws if is_positive(one)]))
    for simulator, kind in sorted({(one["simulator"], one["kind"]) for one in draws}):
        of_it = [one for one in draws if (one["simulator"], one["kind"]) == (simulator, kind)]
        print(kind_line(simulator, kind, of_it))


def summary(name: str, draws: Sequence[Record]) -> str:
    """Return the goal figures of some logs, as a line."""
    answer = [one for one in draws if not one["refuse"]]
    positive = [one for one in draws if is_positive(one)]
    wrongly = sum(one["refuse"] for one in positive)
    text = f"{name}: {len(positive)} of {len(draws)} positive"
    if answer:
        right = sum(is_positive(one) for one in answer)
        text += f" ({right} of the {len(answer)} that have an answer, {_percent(right, answer)})"
    if not positive:
        return text
    covered = sum(one["covered"] for one in positive)
    largest = max((abs(error_of(one)) for one in positive if one["truth"]), default=np.nan)
    return (
        f"{text}; covered {covered} of {len(positive)} ({_percent(covered, positive)}); largest "
        f"error {largest:.2f} %; positive on a log that has no answer {wrongly}"
    )


def kind_line(simulator: str, kind: str, draws: Sequence[Record]) -> str:
    """Return the line of a kind."""
    positive = [one for one in draws if is_positive(one)]
    known = [one for one in positive if one["truth"]]
    errors = [abs(error_of(one)) for one in known]
    maps = [one["map"] for one in positive if one.get("map") is not None]
    seconds = np.median([one["seconds"] for one in draws])
    wanted = "refusal" if draws[0]["refuse"] else "answer"
    return (
        f"{simulator:18.18s} {kind:28.28s} {wanted:7s} {len(draws):3d} logs {len(positive):3d} "
        f"positive {sum(one['covered'] for one in positive):3d} covered, largest error "
        f"{max(errors, default=np.nan):6.2f} %, map {np.median(maps) if maps else np.nan:6.2f} %, "
        f"{seconds:4.0f} s"
    )


def _percent(part: int, whole: Sequence[object]) -> str:
    return f"{100 * part / len(whole):.0f} %"


def _times(name: str, seconds: Sequence[float]) -> str:
    if not seconds:
        return f"{name}: none"
    late = sum(some > SOON for some in seconds)
    return (
        f"{name}: {len(seconds)}, median {np.median(seconds):.1f} s, longest "
        f"{max(seconds):.1f} s, {late} took over {SOON:.0f} s"
    )


def _work(name: str, draw: Draw, numbers: Iterable[int]) -> None:
    """Identify logs in this process and print their lines."""
    ledger = Ledger(name)
    for number in numbers:
        print(line_of(ledger.of(number, partial(result_of, draw))), flush=True)


def _run_batch(name: str, draw: Draw, numbers: Sequence[int]) -> None:
    """Identify logs in processes of their own; one that kills its process gets a line too."""
    ledger = Ledger(name)
    while left := [number for number in numbers if number not in ledger.known()]:
        process = get_context("spawn").Process(target=_work, args=(name, draw, left))
        process.start()
        process.join()
        if process.exitcode:
            first = next((n for n in left if n not in ledger.known()), None)
            if first is None:
                return
            _note_killed(ledger, first, process.exitcode)


def _note_killed(ledger: Ledger, number: int, status: int) -> None:
    """Write down that the process of a log ended by itself."""
    killed = {"simulator": "-", "kind": "-", "seed": -1, "refuse": False, "truth": None}
    killed |= {"status": status, "traceback": True, "warned": [], "seconds": 0.0, "result": False}
    killed |= {"verdict": "refused", "why": "the process ended by itself"}
    print(line_of(ledger.of(number, lambda _: killed)), flush=True)


def developing(seed: int, number: int, folder: Path) -> DrawnLog:
    """Write the log of the kind that a number names, at a seed for developing."""
    return of_kind(list(KINDS)[number], seed, folder)


def main() -> None:
    """Identify and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("count", type=int, nargs="?", default=COUNT)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time")
    parser.add_argument("--developing", type=int, metavar="SEED", help=f"below {HELD_OUT}")
    parser.add_argument("--kind", choices=KINDS, help="the only one, beside --developing")
    asked = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the processes that are begun from here
    name, draw, numbers = "through_command", draw_log, range(asked.first, asked.first + asked.count)
    if asked.developing is not None:
        if asked.developing >= HELD_OUT:
            parser.error(f"seeds from {HELD_OUT} on are held out; give one below.")
        name, numbers = f"through_command_developing_{asked.developing}", range(len(KINDS))
        if asked.kind is not None:
            numbers = [list(KINDS).index(asked.kind)]
        draw = partial(developing, asked.developing)
    elif not recorded_elsewhere():
        print("Nothing of other people's simulators is recorded; the bench stands in for them.")
    batches = [numbers[k : k + _BATCH] for k in range(0, len(numbers), _BATCH)]
    with suppress(KeyboardInterrupt), ThreadPool(asked.jobs) as threads:
        threads.map(partial(_run_batch, name, draw), batches, chunksize=1)
    known = Ledger(name).known()
    print_table([known[number] for number in numbers if number in known])


if __name__ == "__main__":
    main()
