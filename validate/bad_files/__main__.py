"""What the command says to bad files: ``python -m validate.bad_files [WORD]...``.

Every row is a recording, a setting or a saved fit that is bad in one way, given to the real command
in a process of its own. It has to end with exit status 2 and one sentence, within 10 s of processor
time and 1 GB, and to leave nothing behind. Then files that are odd but good: what is said of each
has to be what is said of the good recording, to 9 digits, or it is refused by name. With words on
the command line, only rows with one of them, or of that heading.
"""

import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

from validate.bad_files import saved, settings
from validate.bad_files.binary_recordings import BINARY
from validate.bad_files.command import BYTES, SECONDS, Ended, run
from validate.bad_files.good import csv
from validate.bad_files.odd import ODD
from validate.bad_files.text_recordings import PATHS, TEXTS, Made

Make = Callable[[Path], object]
HEADINGS = ("paths", "text", "binary", "settings", "saved", "odd but good")
_NUMBER = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")


def ended(make: Make, arguments: list[str]) -> Ended:
    """Make files in a folder of their own and give them to the command."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "work"
        folder.mkdir()
        make(folder)
        return run(arguments, folder)


def put(made: Made, study: bytes | None = None) -> Make:
    """Return what makes a recording in a folder, and a study file beside it."""
    name, content = made

    def make(folder: Path) -> None:
        if callable(content):
            content(folder / name)
        else:
            text = content.encode() if isinstance(content, str) else content
            (folder / name).write_bytes(text)
        if study is not None:
            (folder / "study.toml").write_bytes(study)

    return make


def bad() -> Iterator[tuple[str, str, Make, list[str]]]:
    """Yield heading, kind, what makes the files, and the arguments of the command."""
    for heading, recordings in (("paths", PATHS), ("text", TEXTS), ("binary", BINARY)):
        for kind, made in recordings.items():
            yield heading, kind, put(made), ["identify", made[0], "--out", "out"]
    for heading, made_settings in (("settings", settings.cases()), ("saved", saved.cases())):
        for kind, (make, arguments) in made_settings.items():
            yield heading, kind, make, list(arguments)


def fault(end: Ended, *, words: str = "") -> str:
    """Return what is wrong with a refusal, or an empty text.

    Parameters
    ----------
    end : Ended
    words : str
        What the sentence has to have in it.
    """
    lines = end.said.splitlines()
    sentence = len(lines) == 1 and lines[0].startswith("error: ") and lines[0].endswith(".")
    faults = {
        f"status {end.status}": end.status != 2,
        "not one sentence": not sentence or words not in lines[0],
        f"printed {end.printed[:80]!r}": bool(end.printed),
        **_costs(end),
    }
    return "; ".join(what for what, is_so in faults.items() if is_so)


def _costs(end: Ended) -> dict[str, bool]:
    return {
        f"{end.seconds:.0f} s": end.seconds > SECONDS,
        f"{end.memory / 1e6:.0f} MB": end.memory > BYTES,
        f"left {', '.join(end.left)}": bool(end.left),
    }


@cache
def _wanted() -> str:
    return ended(put(("run.csv", csv())), ["check", "run.csv", "--json"]).printed


def same(printed: str, wanted: str) -> bool:
    """Return whether two checks say the same: their words, and their numbers to 9 digits."""
    if _NUMBER.sub("0", printed) != _NUMBER.sub("0", wanted):
        return False
    pairs = zip(_NUMBER.findall(printed), _NUMBER.findall(wanted), strict=True)
    return all(np.isclose(float(a), float(b), rtol=1e-9, atol=1e-12) for a, b in pairs)


def read_right(name: str, end: Ended) -> str:
    """Return what is wrong with a check of an odd file, or an empty text."""
    printed = end.printed.replace(json.dumps(name), '"run.csv"')
    faults = {f"status {end.status}": end.status != 0, "other numbers": False, **_costs(end)}
    faults["other numbers"] = not same(printed, _wanted())
    return "; ".join(what for what, is_so in faults.items() if is_so)


def odd() -> Iterator[tuple[str, Ended, str, str]]:
    """Yield kind, how the command ended, what it said, and what is wrong, of each odd file."""
    for kind, (made, study, words) in ODD.items():
        config = [] if study is None else ["--config", "study.toml"]
        yield kind, (put(made, study), ["check", made[0], "--json", *config]), words


def line(kind: str, end: Ended, said: str, wrong: str) -> str:
    """Return a row of the table."""
    verdict = f"   NOT AS IT SHOULD BE: {wrong}" if wrong else ""
    took = f"{end.status:3d} {end.seconds:5.1f} s {end.memory / 1e6:5.0f} MB"
    return f"{kind:42s} {took}  {said}{verdict}"


def main(words: list[str]) -> None:
    """Print the table, and end with status 1 if a row is not as it should be."""
    counts: dict[str, list[bool]] = {}

    def told(heading: str, kind: str, end: Ended, said: str, wrong: str) -> None:
        if heading not in counts:
            print(f"\n{heading}")
        print(line(kind, end, said, wrong), flush=True)
        counts.setdefault(heading, []).append(not wrong)

    def asked(heading: str, kind: str) -> bool:
        others = [word for word in words if word not in HEADINGS]
        return not words or heading in words or any(word in kind for word in others)

    for heading, kind, make, arguments in bad():
        if asked(heading, kind):
            end = ended(make, arguments)
            told(heading, kind, end, end.said.strip(), fault(end))
    for kind, (make, arguments), refused in odd():
        if asked("odd but good", kind):
            end = ended(make, arguments)
            wrong = fault(end, words=refused) if refused else read_right(arguments[1], end)
            told("odd but good", kind, end, end.said.strip() or "read", wrong)
    good = sum(map(sum, counts.values()))
    print(", ".join(f"{len(rows)} {heading}" for heading, rows in counts.items()))
    print(f"{good} of {sum(map(len, counts.values()))} as they should be")
    sys.exit(good < sum(map(len, counts.values())))


if __name__ == "__main__":
    main(sys.argv[1:])
