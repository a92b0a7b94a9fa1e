"""A campaign: which recordings are identified at which horizons, from which seeds, in what ways."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any

from penode.data.toml_file import COUNT, TABLE, TEXT, Kind, is_number, is_whole, require_kinds
from penode.errors import InputError
from penode.pmsm.study_file import StudyFile, load_study
from penode.pmsm.sweep.recordings import Recorded, digests_of, recorded_in
from penode.pmsm.sweep.task import Task, code_version

_MOST_SEEDS = 10_000
_AUTO = "auto"


def _is_group(value: object) -> bool:
    names = value if isinstance(value, list) else [value]
    return bool(names) and all(isinstance(one, str) for one in names)


_ENTRIES = {
    "recordings": Kind(
        "file names in brackets, those identified together in brackets of their own",
        lambda v: isinstance(v, list) and bool(v) and all(map(_is_group, v)),
    ),
    "name": TEXT,
    "horizons": Kind(
        'whole numbers from 1 or "auto" in brackets',
        lambda v: isinstance(v, list) and all(one == _AUTO or is_whole(one) for one in v),
    ),
    "seeds": COUNT,
    "current": Kind(
        "i_d and i_q in A, in brackets",
        lambda v: isinstance(v, list) and len(v) == 2 and all(map(is_number, v)),
    ),
    "variants": TABLE,
}


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
            digests, error = digests_of(recorded)
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
    entries = {**base.sweep, **asked}
    where = "sweep:" if path is None else f"{path}: sweep:"
    require_kinds(where, entries, _ENTRIES)
    i_d, i_q = entries.get("current", (0.0, 0.0))
    return Campaign(
        recorded_in(path, runs, entries, where),
        _variants(path, given, entries, where) or {"": base},
        _horizons(entries, where),
        _seeds(entries, where),
        (float(i_d), float(i_q)),
    )


def _horizons(entries: Mapping[str, Any], where: str) -> tuple[int | None, ...]:
    horizons = entries.get("horizons", ())
    numbers = [one for one in horizons if one != _AUTO]
    if min(numbers, default=1) < 1 or len(set(horizons)) < len(horizons):
        raise InputError(
            f"{where} horizons {list(horizons)} came; give distinct whole numbers from 1, or auto."
        )
    return tuple(None if one == _AUTO else one for one in horizons)


def _seeds(entries: Mapping[str, Any], where: str) -> tuple[int, ...]:
    if "seeds" not in entries:
        return ()
    count = entries["seeds"]
    if not 1 <= count <= _MOST_SEEDS:
        raise InputError(f"{where} {count} seeds came; give 1 to {_MOST_SEEDS}.")
    return tuple(range(count))


def _variants(
    path: Path | None, given: Mapping[str, Any] | None, entries: Mapping[str, Any], where: str
) -> dict[str, StudyFile]:
    taken = {"sweep", *(one for one in ("horizon", "seed") if f"{one}s" in entries)}
    variants = {}
    for name, changes in entries.get("variants", {}).items():
        if not isinstance(changes, dict):
            raise InputError(f"{where} variant {name} = {changes!r} came; give a table.")
        if twice := sorted(taken & set(changes)):
            raise InputError(
                f"{where} variant {name} has {twice[0]}, which the table [sweep] decides; "
                "say it in one of them."
            )
        try:
            variants[name] = load_study(path, given, changes)
        except InputError as error:
            raise InputError(f"variant {name}: {error}") from error
    return variants
