"""A campaign: which recordings are identified at which horizons, from which seeds, in what ways."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from penode.data.toml_file import COUNT, FINITE, held_against
from penode.errors import InputError
from penode.pmsm.study_file import StudyFile, load_study
from penode.pmsm.sweep.recordings import Recorded, digests_of, recorded_in
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
    where = "" if path is None else f"{path}: "
    entries = held_against(_Sweep, {**base.sweep, **asked}, f"{where}sweep.")
    seeds = () if entries.seeds is None else tuple(range(entries.seeds))
    return Campaign(
        recorded_in(path, runs, entries.recordings, entries.name),
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
