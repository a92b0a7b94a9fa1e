"""Which files a sweep takes, and what their names say of machine and date."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from penode.data.content import Content
from penode.errors import InputError


@dataclass(frozen=True)
class Recorded:
    """One or several files that are identified together, as the table names them.

    Machine and date, YYYY-MM-DD, are what the name says of them.
    """

    name: str
    files: tuple[Path, ...]
    machine: str | None = None
    date: str | None = None


def digests_of(recorded: Recorded) -> tuple[tuple[str, ...], str]:
    """Return the SHA-256 of each file, or a sentence why one cannot be read."""
    digests = []
    for path in recorded.files:
        try:
            with Content(str(path)) as content:
                for _ in content.blocks():
                    pass
                digests.append(content.sha256)
        except InputError as error:
            return (), str(error)
        except OSError as error:
            reason = error.strerror or type(error).__name__
            return (), f"{path}: the file cannot be read ({reason}); check it."
    return tuple(digests), ""


def recorded_in(
    path: Path | None, runs: Sequence[Path], entries: Sequence[str | list[str]], name: str | None
) -> tuple[Recorded, ...]:
    """Return the recordings of a campaign; refuse a pattern that cannot be, and none at all.

    Names begin in the folder of the study file; ``runs`` stand in place of the file's recordings,
    each by itself; ``entries`` and ``name`` are those of the table ``[sweep]``.
    """
    where = "sweep" if path is None else f"{path}: sweep"
    pattern = _pattern(name, where)
    if runs:
        return tuple(_recorded((run,), Path(), pattern) for run in runs)
    folder = Path() if path is None else path.parent
    groups: list[tuple[Path, ...]] = []
    for entry in entries:
        several = [entry] if isinstance(entry, str) else entry
        every = tuple(file for one in several for file in _matching(folder, one, where))
        groups += [(file,) for file in every] if isinstance(entry, str) else [every]
    if not groups:
        raise InputError(
            f'{where}: no recordings; name some, or give recordings = ["logs/*.csv"] in the table '
            "[sweep] of a study file."
        )
    return tuple(_recorded(files, folder, pattern) for files in dict.fromkeys(groups))


def _matching(folder: Path, pattern: str, where: str) -> list[Path]:
    """Return files in order; a name that is not there is one too, and its row will say so."""
    if not any(mark in pattern for mark in "*?["):
        return [folder / pattern]
    try:
        found = sorted(file for file in folder.glob(pattern) if file.is_file())
    except (ValueError, NotImplementedError, IndexError) as error:
        raise InputError(
            f"{where}.recordings must hold patterns within the folder of the study file, got "
            f"{pattern!r} ({error})."
        ) from error
    if not found:
        raise InputError(
            f"{where}.recordings: no file matches {pattern!r} in {folder}; check the pattern."
        )
    return found


def _pattern(text: str | None, where: str) -> re.Pattern[str] | None:
    if text is None:
        return None
    try:
        pattern = re.compile(text)
    except (re.error, OverflowError, RecursionError) as error:
        raise InputError(
            f"{where}.name must be a regular expression, got {text!r} ({error})."
        ) from error
    if not pattern.groupindex.keys() or not set(pattern.groupindex) <= {"machine", "date"}:
        raise InputError(
            f"{where}.name must have groups named machine or date, got {text!r}; fix: "
            r"'(?P<machine>\w+)_(?P<date>\d{4}-\d\d-\d\d)'."
        )
    return pattern


def _recorded(files: tuple[Path, ...], folder: Path, pattern: re.Pattern[str] | None) -> Recorded:
    names = [
        (file.relative_to(folder) if file.is_relative_to(folder) else file).as_posix()
        for file in files
    ]
    name = " + ".join(names)
    found = pattern.search(name) if pattern else None
    said = found.groupdict() if found else {}
    return Recorded(name, files, said.get("machine"), _date(said.get("date"), name))


def _date(text: str | None, name: str) -> str | None:
    if text is None:
        return None
    try:
        return date.fromisoformat(re.sub(r"[_.]", "-", text)).isoformat()
    except ValueError as error:
        raise InputError(
            f"{name}: the date in a name must be like 2026-03-31 or 20260331, got {text!r}; "
            "correct sweep.name."
        ) from error
