"""Study files: what to identify, and how the columns of the recordings map to channels, as TOML."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from msgspec import Struct, defstruct
from msgspec.structs import asdict

from penode.data.experiment import Experiment
from penode.data.mapping import Origin
from penode.data.table import TIME
from penode.data.toml_file import COUNT, FINITE, NATURAL, POSITIVE, held_against, read_toml
from penode.errors import InputError
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.term_registry import terms_of
from penode.pmsm.machine.terms import SPEED
from penode.pmsm.points.operating_points import load_runs
from penode.pmsm.recording.drive_mapping import (
    AS_NUMBERS,
    BASES,
    MAPPED,
    TIME_STEP,
    DriveMapping,
    DriveOrigin,
)
from penode.pmsm.recording.imperfections import DEFAULT_ACCURACY, Accuracy
from penode.pmsm.recording.name_plate import NamePlate
from penode.pmsm.recording.stationary_frame import LINK
from penode.pmsm.study_settings import DEFAULT_STUDY, Study


class _Time(Struct, forbid_unknown_fields=True, frozen=True):
    """The table of the channel t."""

    column: str
    unit: str = ""
    scale: FINITE = 1.0

    def __post_init__(self) -> None:
        if self.scale == 0:
            raise ValueError("scale must be a number other than 0, got 0.0.")


class _Channel(_Time, forbid_unknown_fields=True, frozen=True):
    """The table of any other channel."""

    sign: Literal[1, -1] = 1
    delay: int = 0
    times: str = ""
    rms: bool = False
    mechanical: bool = False


def _table(name: str, kinds: Mapping[str, Any]) -> Any:
    """Return the schema of a table that may have entries of these names, and need not."""
    entries = [(key, kind | None, None) for key, kind in kinds.items()]
    return defstruct(name, entries, forbid_unknown_fields=True)


_FILE: Any = _table(
    "StudyFile",
    {
        "flux_map": str,
        "horizon": COUNT | Literal["auto"],
        "pole_pairs": COUNT,
        "seed": NATURAL,
        "inverter": bool,
        "terms": list[str],
        "angle_orders": list[int],
        "hold": str,
        "samples": COUNT,
        "purpose": str,
        "train_anyway": bool,
        **dict.fromkeys((*BASES.values(), LINK, TIME_STEP), POSITIVE),
        SPEED.name: FINITE,
        "resample": Literal["linear"],
        "name_plate": _table("NamePlate", {one.name: POSITIVE for one in fields(NamePlate)}),
        "accuracy": _table("Accuracy", dict.fromkeys(DEFAULT_ACCURACY.declared, float)),
        "channels": _table(
            "Channels", {name: str | (_Time if name == TIME else _Channel) for name in MAPPED}
        ),
        "sweep": dict[str, Any],
    },
)


#: Entries of what is a number for a whole recording.
_NUMBERS = (*BASES.values(), *AS_NUMBERS, TIME_STEP)


@dataclass(frozen=True)
class StudyFile:
    """What a study file says.

    Attributes
    ----------
    study : Study
        Flux map, horizon, inverter, angle orders, hold, seed, pole pairs.
    mapping : DriveMapping
        Where the channels come from; that of canonical columns where the file maps none.
    sweep : mapping of str to object
        Entries of the table ``[sweep]``, for `penode sweep`.
    entries : mapping of str to object
        As they stand in the file; none where there is no file.
    """

    study: Study = DEFAULT_STUDY
    mapping: DriveMapping = field(default_factory=DriveMapping)
    sweep: Mapping[str, Any] = field(default_factory=dict)
    entries: Mapping[str, Any] = field(default_factory=dict)

    def load(self, path: str | Path) -> Experiment:
        """Load a recording as the file maps it; see `DriveMapping.load`."""
        return self.mapping.load(path)

    def load_stretches(self, path: str | Path) -> tuple[Experiment, ...]:
        """Load a recording that may have gaps; see `DriveMapping.load_stretches`."""
        return self.mapping.load_stretches(path)

    def load_points(self, path: str | Path) -> Experiment:
        """Load a table of operating points; see `penode.pmsm.points.operating_points.load_runs`."""
        # Points have no time: that of a recording beside is none of theirs.
        constants = {n: one for n, one in self.mapping.constants.items() if n != TIME_STEP}
        recordings, points = load_runs([Path(path)], replace(self.mapping, constants=constants))
        if points is None:
            raise InputError(
                f"{path}: a table of operating points must have no column of time, got "
                f"{len(recordings[0])} samples of a recording; identify it as one."
            )
        return points


def load_study(
    path: str | Path | None = None,
    given: Mapping[str, Any] | None = None,
    changes: Mapping[str, Any] = MappingProxyType({}),
) -> StudyFile:
    """Read a study file.

    Parameters
    ----------
    path : str or Path, optional
        A TOML file; without one, canonical columns and the default study.
    given : mapping of str to object, optional
        Entries that override the file's.
    changes : mapping of str to object
        Entries in place of the file's, as a file has them; they override what is given.

    Returns
    -------
    StudyFile

    Raises
    ------
    InputError
        If there is no such file, it is not TOML, or an entry is unknown, missing or of the wrong
        kind; the message names the file and the entry, and suggests the nearest known one.
    """
    given = given or {}
    # The channels of a shaft need the pole pairs, too.
    pairs = {name: given[name] for name in ("pole_pairs",) if name in given}
    own = {} if path is None else read_toml(Path(path))
    entries = {**own, **pairs, **changes}
    where = "" if path is None else f"{path}: "
    asked = held_against(_FILE, entries, where)
    channels = {} if asked.channels is None else asdict(asked.channels)
    try:
        mapping = DriveMapping(
            {name: _origin(name, one) for name, one in channels.items() if one is not None},
            asked.pole_pairs,
            asked.resample is not None,
            {name: entries[name] for name in _NUMBERS if name in entries},
        )
        read = StudyFile(_study(entries), mapping, asked.sweep or {}, own)
    except InputError as error:
        raise InputError(f"{where}{error}") from error
    return replace(read, study=_study({**entries, **given, **changes})) if given else read


def _study(entries: Mapping[str, Any]) -> Study:
    """Return the study of entries of a file, some of them overridden by options."""
    settings = {f.name: entries[f.name] for f in fields(Study) if f.name in entries}
    channels = entries.get("channels", {}).items()
    settings["of_shaft"] = tuple(
        name for name, one in channels if isinstance(one, Mapping) and one.get("mechanical")
    )
    if settings.get("horizon") == "auto":
        settings["horizon"] = None
    if "angle_orders" in settings:
        settings["angle_orders"] = tuple(settings["angle_orders"])
    if "accuracy" in settings:
        settings["accuracy"] = Accuracy(**settings["accuracy"])
    if "name_plate" in settings:
        settings["name_plate"] = NamePlate(**settings["name_plate"])
    terms = terms_of(settings.get("terms", ()))
    if "inverter" in entries:  # a word for dead time, which is otherwise left to the data
        settings["candidates"] = ()
        terms = tuple(term for term in terms if term.role != DeadTime.role)
        terms += (DeadTime(),) if entries["inverter"] else ()
    return Study(**{**settings, "terms": terms})


def _origin(name: str, entry: str | _Time) -> DriveOrigin:
    """Return where a channel comes from: a column's name alone, or a table."""
    told = asdict(_Channel(entry) if isinstance(entry, str) else entry)
    own = {key: told.pop(key) for key in ("rms", "mechanical") if key in told}
    return DriveOrigin(Origin(si=MAPPED[name], **told), **own)
