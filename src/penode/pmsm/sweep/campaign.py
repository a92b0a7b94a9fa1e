"""A campaign: which recordings are identified at which horizons, from which seeds, in what ways."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from penode.data.content import Content
from penode.data.toml_file import COUNT, FINITE, held_against
from penode.errors import InputError
from penode.pmsm.study_file import StudyFile, load_study
from penode.pmsm.sweep.task import Task, code_version


class _Sweep(Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[sweep]`` of a study file."""

    recordings: list[str | Annotated[list[str], Meta(min_length=1)]] = []
    name: str | None = None
    horizons: list[COUNT | Literal["auto"]] = []
    seeds: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    current: tuple[FINITE, FINITE] = (0.0, 0.0)
    variants: dict[str, dict[str, Any]] = {}

    def __post_init__(self) -> None:
        if len(set(self.horizons)) < len(self.horizons):
            raise ValueError(f"horizons must differ, got {self.horizons}; remove one of two.")


@dataclass(frozen=True)
class Recorded:
    """One or several files that are identified together, as the table names them.

    Machine and date, YYYY-MM-DD, are what the name says of them.
    """

    name: str
    files: tuple[Path, ...]
    machine: str | None = None
    date: str | None = None


@dataclass(frozen=True)
class Planned:
    """A row of the table to come: its labels, and its task, or why the recording cannot be read.

    The labels are ``recording``, ``machine``, ``date``, ``variant``, ``horizon`` and ``seed``.
    """

    labels: Mapping[str, Any]
    task: Task | None
    error: str = ""


@dataclass(frozen=True)
class Campaign:
    """Recordings x variants x horizons x seeds, each an identification of its own.

    A horizon, in steps, of None is selected from the data; no horizons or seeds stand for those of
    each variant. ``current`` is i_d and i_q in A at which maps are compared.
    """

    recordings: tuple[Recorded, ...]
    variants: Mapping[str, StudyFile] = field(default_factory=lambda: {"": StudyFile()})
    horizons: tuple[int | None, ...] = ()
    seeds: tuple[int, ...] = ()
    current: tuple[float, float] = (0.0, 0.0)

    def __len__(self) -> int:
        grid = max(len(self.horizons), 1) * max(len(self.seeds), 1)
        return len(self.recordings) * len(self.variants) * grid

    def planned(self) -> Iterator[Planned]:
        """Yield every row in order; a file is read when its turn comes, for its digest."""
        for recorded in self.recordings:
            digests, error = _digests(recorded)
            files = tuple(str(path) for path in recorded.files)
            for labels in self._of(recorded):
                asked = self.variants[labels["variant"]]
                study = replace(asked.study, horizon=labels["horizon"], seed=labels["seed"])
                one = replace(asked, study=study)
                task = None if error else Task(files, digests, one, self.current, code_version())
                yield Planned(labels, task, error)

    def labels(self) -> Iterator[dict[str, Any]]:
        """Yield what every row is called, in order."""
        for recorded in self.recordings:
            yield from self._of(recorded)

    def _of(self, recorded: Recorded) -> Iterator[dict[str, Any]]:
        named = {"recording": recorded.name, "machine": recorded.machine, "date": recorded.date}
        for variant, asked in self.variants.items():
            horizons = self.horizons or (asked.study.horizon,)
            for horizon, seed in product(horizons, self.seeds or (asked.study.seed,)):
                yield {**named, "variant": variant, "horizon": horizon, "seed": seed}


def load_campaign(
    path: Path | None,
    runs: Sequence[Path] = (),
    given: Mapping[str, Any] | None = None,
    asked: Mapping[str, Any] = MappingProxyType({}),
) -> Campaign:
    """Read the campaign that a study file declares in its table ``[sweep]``, if it has one.

    ``runs`` are recordings in place of the file's, each identified by itself; ``given`` overrides
    entries of the study, ``asked`` those of ``[sweep]``.
    """
    base = load_study(path, given)
    where = "" if path is None else f"{path}: "
    entries = held_against(_Sweep, {**base.sweep, **asked}, f"{where}sweep.")
    seeds = () if entries.seeds is None else tuple(range(entries.seeds))
    return Campaign(
        _recordings(path, runs, entries.recordings, entries.name),
        _variants(path, given, entries, where) or {"": base},
        tuple(None if one == "auto" else one for one in entries.horizons),
        seeds,
        entries.current,
    )


def _variants(
    path: Path | None, given: Mapping[str, Any] | None, entries: _Sweep, where: str
) -> dict[str, StudyFile]:
    taken = {"sweep": True, "horizon": bool(entries.horizons), "seed": entries.seeds is not None}
    variants = {}
    for name, changes in entries.variants.items():
        if twice := [one for one in changes if taken.get(one)]:
            raise InputError(
                f"{where}sweep.variants.{name} has {twice[0]}, which the table [sweep] decides; "
                "say it in one of them."
            )
        try:
            variants[name] = load_study(path, given, changes)
        except InputError as error:
            raise InputError(f"variant {name}: {error}") from error
    return variants


# --- which files, and what their names say ----------------------------------------------------


def _digests(recorded: Recorded) -> tuple[tuple[str, ...], str]:
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


def _recordings(
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
