"""Damaged files of every format: ``python -m fuzz.readers --seconds 3600 --seed 1``.

Every case is a good file with some bytes changed. It has to become columns, or be refused in one
sentence that names the file; nothing else may happen, no case may take 10 s of processor time or
two minutes by the clock, and neither this process nor the child that decodes may grow beyond 2 GB.
What breaks this is kept in ``out/fuzz`` and listed at the end, with exit status 1. Formats get
their turns so that all near their goals alike: 100 000 cases, 5000 of the slow MDF.
"""

import argparse
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from validate.processes import ended_children, spent

from fuzz.damage import damaged
from fuzz.seeds import SEEDS
from penode.data.experiment import Source
from penode.data.isolation import Decoder
from penode.data.load import experiments_of
from penode.data.mapping import own_names
from penode.data.readers import csv
from penode.data.table import Table
from penode.errors import InputError, printable
from penode.pmsm import load_study

SLOWEST = 10.0  # s of processor time
LONGEST = 120.0  # s by the clock
LARGEST = 2e9  # bytes
_AT_ONCE = 100  # cases of the format that is the farthest from its goal
_GOAL, _GOALS = 100_000, {"mdf": 5_000}
_READERS = {"mat": "mat", "mat packed": "mat", "mat 7.3": "mat", "mdf": "mdf"}
_READERS |= {"parquet": "parquet", "tdms": "tdms", "xlsx": "xlsx"}


class Decoders:
    """A reader in a child process that serves many files, and is replaced where it ended."""

    def __init__(self, reader: str) -> None:
        self._reader = reader
        self._child: Decoder | None = None

    def read(self, file: str, content: bytes) -> Table:
        """Decode a file."""
        if self._child is not None and not self._child.alive:
            self.close()
        if self._child is None:
            self._child = Decoder(self._reader)
        return self._child.read(file, len(content), [content])

    def worked(self) -> float:
        """Return the processor time in s of the child that runs, where the system tells it."""
        return 0.0 if self._child is None else spent(self._child.process)

    def close(self) -> None:
        """End the child."""
        if self._child is not None:
            self._child.close()
        self._child = None


@dataclass
class Tally:
    """What became of the cases of one format."""

    outcomes: Counter[str] = field(default_factory=Counter)
    findings: list[str] = field(default_factory=list)
    slowest: float = 0.0


def check(read: Callable[[bytes], Table | None], content: bytes) -> str:
    """Read one case and return what became of it.

    Parameters
    ----------
    read : callable
        From content to columns, or None where there are none to have.
    content : bytes

    Raises
    ------
    AssertionError
        If a refusal is not one printable sentence that names the file.
    """
    outcome = "refused"
    try:
        table = read(content)
        if table is None:
            return "read"
        outcome = "read, but no recording"
        for values in table.columns.values():
            assert values.dtype == np.float64, values.dtype
            assert values.ndim == 1, values.shape
        assert all(name == printable(name) for name in table.columns)
        experiments_of(table, Source("case", ""), own_names(table))
    except InputError as error:
        sentence = str(error)
        assert "case" in sentence, sentence
        assert sentence.endswith("."), sentence
        assert sentence == printable(sentence), sentence
        assert len(sentence) < 4000, len(sentence)
        ends = ("crashed", "took longer", "took more")
        return next((f"refused, {end}" for end in ends if end in sentence), outcome)
    return "read"


def readers(folder: Path) -> tuple[dict[str, Callable[[bytes], Table | None]], list[Decoders]]:
    """Return the reader of each format, and the children."""
    children = {name: Decoders(reader) for name, reader in _READERS.items()}
    path = folder / "case.toml"

    def study(content: bytes) -> None:
        path.write_bytes(content)
        load_study(path)

    found: dict[str, Callable[[bytes], Table | None]] = {
        "csv": lambda content: csv.read("case.csv", content),
        "csv packed": lambda content: csv.read_packed("case.csv.gz", content),
        "study": study,
    }
    for name, child in children.items():
        found[name] = lambda content, child=child: child.read("case", content)  # type: ignore[misc]
    return found, list(children.values())


def peak() -> float:
    """Return the largest memory in bytes that this process or a child that ended has taken."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return 1024.0 * max(resource.getrusage(kind).ru_maxrss for kind in kinds)


def run(seconds: float, seed: int, out: Path, formats: list[str]) -> dict[str, Tally]:
    """Read damaged files until the time is up, about as many of each format.

    Parameters
    ----------
    seconds : float
    seed : int
    out : Path
        Folder for the files that were neither read nor refused.
    formats : list of str
        Keys of `SEEDS`.

    Returns
    -------
    dict of str to Tally
        By format.
    """
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    seeds = {name: SEEDS[name]() for name in formats}
    tallies = {name: Tally() for name in formats}
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        read, children = readers(Path(folder))
        while time.monotonic() < end:
            name = min(tallies, key=lambda one: tallies[one].outcomes.total() / goal(one))
            tally = tallies[name]
            for _ in range(_AT_ONCE):
                content = damaged(rng, seeds[name])
                finding = one_case(read[name], content, tally, children)
                if finding:
                    kept = out / f"{name.replace(' ', '_')}-{len(tally.findings)}.bin"
                    kept.write_bytes(content)
                    tally.findings.append(f"{kept}: {finding}")
        for child in children:
            child.close()
    return tallies


def goal(name: str) -> int:
    """Return how many cases of a format an hour is to have."""
    return _GOALS.get(name, _GOAL)


def one_case(
    read: Callable[[bytes], Table | None], content: bytes, tally: Tally, children: list[Decoders]
) -> str:
    """Read one case into the tally, and return what was wrong with it, or an empty text."""

    def worked() -> float:
        return time.process_time() + ended_children() + sum(one.worked() for one in children)

    before, begin, began, finding = peak(), worked(), time.monotonic(), ""
    try:
        tally.outcomes[check(read, content)] += 1
    except Exception:
        tally.outcomes["neither"] += 1
        finding = traceback.format_exc(limit=-3).strip()
    taken, waited = worked() - begin, time.monotonic() - began
    tally.slowest = max(tally.slowest, taken)
    if not finding and (taken > SLOWEST or waited > LONGEST):
        finding = f"it took {taken:.1f} s of processor time, {waited:.1f} s by the clock"
    if not finding and peak() - before > LARGEST:
        finding = f"it took {(peak() - before) / 1e9:.1f} GB"
    return finding


def main() -> None:
    """Print a line for each format and what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--formats", nargs="+", choices=list(SEEDS), default=list(SEEDS))
    asked = parser.parse_args()
    warnings.simplefilter("error")
    tallies = run(asked.seconds, asked.seed, asked.out, asked.formats)
    for name, tally in tallies.items():
        counts = ", ".join(f"{n} {what}" for what, n in sorted(tally.outcomes.items()))
        total = tally.outcomes.total()
        share = f"{total:8d} of {goal(name)} cases"
        print(f"{name:11s} {share}: {counts}; slowest {tally.slowest:.1f} s")
    findings = [finding for tally in tallies.values() for finding in tally.findings]
    print(f"peak {peak() / 2**20:.0f} MiB; {len(findings)} findings")
    print("\n".join(findings))
    sys.exit(bool(findings))


if __name__ == "__main__":
    main()
