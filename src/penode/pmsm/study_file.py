"""Study files: what to identify, and how the columns of the recordings map to channels, as TOML."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from penode.data.experiment import Experiment
from penode.data.mapping import Origin
from penode.data.table import TIME
from penode.data.toml_file import (
    COUNT,
    FACTOR,
    FLAG,
    NAMES,
    NATURAL,
    NUMBER,
    POSITIVE,
    SIGN,
    TABLE,
    TEXT,
    WHOLE,
    WHOLES,
    Kind,
    is_whole,
    read_toml,
    require_kinds,
    require_known,
)
from penode.errors import InputError
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.term_registry import terms_of
from penode.pmsm.recording.drive_mapping import BASES, RECORDED, DriveMapping, DriveOrigin
from penode.pmsm.recording.imperfections import DEFAULT_ACCURACY, Accuracy
from penode.pmsm.recording.name_plate import NamePlate
from penode.pmsm.recording.stationary_frame import LINK
from penode.pmsm.study_settings import DEFAULT_STUDY, Study

#: Entries of a channel and what they hold.
_CHANNEL = {
    "column": TEXT,
    "unit": TEXT,
    "scale": FACTOR,
    "sign": SIGN,
    "delay": WHOLE,
    "times": TEXT,
    "rms": FLAG,
    "mechanical": FLAG,
}
_TIME = {key: _CHANNEL[key] for key in ("column", "unit", "scale")}
_SETTINGS = {
    "flux_map": TEXT,
    "horizon": Kind(f'{COUNT.words}, or "auto"', lambda v: v == "auto" or is_whole(v)),
    "pole_pairs": COUNT,
    "seed": NATURAL,
    "inverter": FLAG,
    "terms": NAMES,
    "angle_orders": WHOLES,
    "hold": TEXT,
    "samples": COUNT,
    "purpose": TEXT,
    "train_anyway": FLAG,
    **dict.fromkeys((*BASES.values(), LINK), POSITIVE),
    "resample": Kind('"linear"', lambda value: value == "linear"),
    "name_plate": TABLE,
    "accuracy": TABLE,
    "channels": TABLE,
    "sweep": TABLE,
}
_NAME_PLATE = {entry.name: POSITIVE for entry in fields(NamePlate)}
_ACCURACY = dict.fromkeys(DEFAULT_ACCURACY.declared, NUMBER)


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
    """

    study: Study = DEFAULT_STUDY
    mapping: DriveMapping = field(default_factory=DriveMapping)
    sweep: Mapping[str, Any] = field(default_factory=dict)

    def load(self, path: str | Path) -> Experiment:
        """Load a recording as the file maps it; see `DriveMapping.load`."""
        return self.mapping.load(path)

    def load_stretches(self, path: str | Path) -> tuple[Experiment, ...]:
        """Load a recording that may have gaps; see `DriveMapping.load_stretches`."""
        return self.mapping.load_stretches(path)


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
    entries = {**({} if path is None else read_toml(Path(path))), **changes}
    read = _read(path, entries)
    return replace(read, study=_study({**entries, **given, **changes})) if given else read


def _read(path: str | Path | None, entries: dict[str, Any]) -> StudyFile:
    try:
        return _study_file(entries)
    except InputError as error:
        raise InputError(str(error) if path is None else f"{path}: {error}") from error


def _study_file(entries: dict[str, Any]) -> StudyFile:
    require_kinds("entry", entries, _SETTINGS)
    require_known("channel", entries.get("channels", {}), RECORDED)
    channels = {name: _channel(name, e) for name, e in entries.get("channels", {}).items()}
    constants = {name: entries[name] for name in (*BASES.values(), LINK) if name in entries}
    mapping = DriveMapping(channels, entries.get("pole_pairs"), "resample" in entries, constants)
    return StudyFile(_study(entries), mapping, entries.get("sweep", {}))


def _study(entries: Mapping[str, Any]) -> Study:
    """Return the study of entries of a file, some of them overridden by options."""
    settings = {f.name: entries[f.name] for f in fields(Study) if f.name in entries}
    if settings.get("horizon") == "auto":
        settings["horizon"] = None
    if "angle_orders" in settings:
        settings["angle_orders"] = tuple(settings["angle_orders"])
    if "accuracy" in settings:
        require_kinds("accuracy:", settings["accuracy"], _ACCURACY)
        settings["accuracy"] = Accuracy(**settings["accuracy"])
    if "name_plate" in settings:
        require_kinds("name_plate:", settings["name_plate"], _NAME_PLATE)
        settings["name_plate"] = NamePlate(**settings["name_plate"])
    terms = terms_of(settings.get("terms", ()))
    if "inverter" in entries:  # a word for dead time, which is otherwise left to the data
        settings["candidates"] = ()
        terms = tuple(term for term in terms if term.role != DeadTime.role)
        terms += (DeadTime(),) if entries["inverter"] else ()
    return Study(**{**settings, "terms": terms})


def _channel(name: str, entry: Any) -> DriveOrigin:
    """Return one channel: a column's name alone, or a table."""
    if isinstance(entry, str):
        entry = {"column": entry}
    if not isinstance(entry, dict):
        raise InputError(f"channel {name} must be the name of a column, or a table, got {entry!r}.")
    require_kinds(f"channel {name}:", entry, _TIME if name == TIME else _CHANNEL)
    if "column" not in entry:
        raise InputError(f"channel {name}: column is missing; name the column of the file.")
    own = {key: entry[key] for key in ("rms", "mechanical") if key in entry}
    rest = {key: value for key, value in entry.items() if key not in own}
    return DriveOrigin(Origin(si=RECORDED[name], **rest), **own)
