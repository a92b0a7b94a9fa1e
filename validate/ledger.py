"""Ledger: what became of each draw, a JSON line each, so that a stopped campaign goes on."""

import json
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import jax

Record = dict[str, Any]


class Ledger:
    """Results of draws in ``out/validate/NAME.jsonl``; delete the file to begin anew.

    Several processes may work on draws of their own at the same time.

    Attributes
    ----------
    path : Path
    """

    def __init__(self, name: str):
        self.path = Path("out") / "validate" / f"{name}.jsonl"

    def known(self) -> dict[int, Record]:
        """Return the results so far by the number of the draw."""
        if not self.path.exists():
            return {}
        records = [json.loads(line) for line in self.path.read_text().splitlines()]
        return {record["draw"]: record for record in records}

    def of(self, draw: int, make: Callable[[int], Record], alike: bool = False) -> Record:
        """Return the result of a draw: what is written, or what is made now and written down.

        Draws that are alike share compiled programs; those of others are dropped, as nothing else
        drops them.
        """
        known = self.known()
        if draw not in known:
            record = {"draw": draw, **make(draw)}
            if not alike:
                jax.clear_caches()
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a") as file:
                file.write(json.dumps(record) + "\n")
            return record
        return known[draw]


def run_draws(
    name: str,
    most: int,
    make: Callable[[int], Record],
    line: Callable[[Record], str],
    table: Callable[[list[Record]], None],
) -> None:
    """Make draws, ``COUNT FIRST`` of the command line, and print a line each, then the table.

    Parameters
    ----------
    name : str
        Of the ledger.
    most : int
        Draws without a count on the command line.
    make : callable
        Returns what became of a draw.
    line : callable
        Returns the line of a draw.
    table : callable
        Prints the table of those so far, after Ctrl-C too.
    """
    count = int(sys.argv[1]) if len(sys.argv) > 1 else most
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    ledger, draws = Ledger(name), list[Record]()
    with suppress(KeyboardInterrupt):
        for number in range(first, first + count):
            draws.append(ledger.of(number, make))
            print(line(draws[-1]), flush=True)
    table(draws)
