"""Forty kinds of physics, drawn, each identified by default: ``python -m validate.drawn_physics``.

``[COUNT] [FIRST] [NAME ...] [--jobs 2]``: draws FIRST to FIRST + COUNT (10 from 0) of the kinds
named, or of all 40 of `validate.physics`: parameters, excitation and noise. Two to six states,
stiff and not, all of them measured or some. A recording of 800 to 4000 samples with 0.5 to 3 %
noise is simulated by LSODA, which shares nothing with penode, and ``identify(model, [recording])``
begins 25 to 60 % off with nothing else given.

24 kinds are well specified. Of 16 the plant has more than the model: Coulomb friction, a delay, an
unmodelled mode or a saturation. Their truth is the plant's own parameters, those it would have
without what was added: an interval has to hold them although the model cannot be right.

The table has for each kind how many verdicts are positive; how many of their finite intervals
(95 %) hold the truth, and how many intervals are infinite; the median error over half an interval;
how many fits are right, whatever is said of them, and how many of these are called implausible or
are not positive; the median error (root mean square of the parameters' relative ones) and its ratio
to that of the ladder's best rung, beside the same of the first rung and of the last; seconds of the
first draw and of later ones, and how many programs a later one still compiles.

*Right* are parameters that all lie in finite intervals or within 2 %, with a free run on a
recording of its own at most 1.2 times as far off as that of the best rung.

What became of each is kept in ``out/validate/drawn_physics.jsonl``; delete it after a change.
Ctrl-C prints the table so far; the same command goes on. The draws of a kind follow each other in
one process, so that compiled programs serve them all.
"""

import argparse
import json
import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.pool import ThreadPool
from pathlib import Path

from validate.ledger import Record
from validate.physics.kinds import KINDS
from validate.physics.outcome import result_of
from validate.physics.table import line_of, print_table

COUNT = 10
FILE = Path("out") / "validate" / "drawn_physics.jsonl"


def known() -> dict[str, Record]:
    """Return the results so far by kind and number."""
    if not FILE.exists():
        return {}
    records = [json.loads(line) for line in FILE.read_text().splitlines()]
    return {record["draw"]: record for record in records}


def keep(record: Record) -> None:
    """Write a result down and print its line."""
    FILE.parent.mkdir(parents=True, exist_ok=True)
    with FILE.open("a") as file:
        file.write(json.dumps(record, allow_nan=False) + "\n")
    print(line_of(record), flush=True)


def _work(name: str, numbers: Sequence[int]) -> None:
    """Identify draws of a kind in this process."""
    for number in numbers:
        keep(result_of(KINDS[name], number))


def _run_kind(numbers: Sequence[int], name: str) -> None:
    """Identify draws of a kind in a process of their own; one that ends it gets a line too."""
    while left := [number for number in numbers if f"{name} {number}" not in known()]:
        process = get_context("spawn").Process(target=_work, args=(name, left))
        process.start()
        process.join()
        if process.exitcode == -signal.SIGTERM:  # by a person: no result
            return
        if process.exitcode:
            reason = f"the process ended by itself, status {process.exitcode}"
            first = next((n for n in left if f"{name} {n}" not in known()), None)
            if first is not None:
                keep(_killed(name, first, reason))


def _killed(name: str, number: int, reason: str) -> Record:
    record = {"draw": f"{name} {number}", "physics": name, "number": number, "truth": {}}
    record |= {"misfits": KINDS[name].misfits, "verdict": "failed", "reason": reason, "rungs": []}
    nothing = {"seconds": 0.0, "compiled": 0, "compiling": 0.0, "warned": []}
    return record | {"positive": False, **nothing}


def main(arguments: Sequence[str] | None = None) -> None:
    """Identify and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("count", type=int, nargs="?", default=COUNT)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(KINDS))
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time")
    asked = parser.parse_args(arguments)
    if unknown := [name for name in asked.names if name not in KINDS]:
        parser.error(f"no kind {', '.join(unknown)}; there are {', '.join(KINDS)}.")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the processes that are begun from here
    numbers, names = range(asked.first, asked.first + asked.count), asked.names or list(KINDS)
    with suppress(KeyboardInterrupt), ThreadPool(asked.jobs) as threads:
        threads.map(partial(_run_kind, numbers), names, chunksize=1)
    done = known()
    wanted = [f"{name} {number}" for name in names for number in numbers]
    print_table([done[key] for key in wanted if key in done])


if __name__ == "__main__":
    main()
